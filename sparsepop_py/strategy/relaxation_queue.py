"""Which rung next: what is left of the catalogue, by expected gain per second.

A rung whose bound depends on the box may be climbed on a box that linear programs have
tightened first. With seconds t of tightening, s of the relaxation and a chance p that it
closes the gap without, that is expected to cost t + s against s + (1 - p) (t + s).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from sparsepop_py.relaxation.hierarchy import Recipe
from sparsepop_py.strategy.shared_state import Ground
from sparsepop_py.verified.box.scaling import Scaled

__all__ = ["NARROW", "PROGRAM", "TIGHTENING", "Agenda", "worth_in_parts"]

PROGRAM = "linear program"  # names under which experience keeps their seconds
TIGHTENING = "tightening"
NARROW = 12  # variables whose bounds linear programs tighten at the root
_DEAR = 3.0  # tightening that takes this many times as long as the next relaxation is left out
_LEVEL = 0.1  # of a gap (as a logarithm) that cutting closes in the time of a linear program
_WEAK = 0.3  # share of the progress that linear relaxations and the like make at most
_LINEAR = Recipe("linear", 0.0, "linear")
_TIGHTENED = ("star", "split", "mixed")


@dataclass(eq=False)
class Agenda:
    """The rungs that one objective may still climb.

    Parameters
    ----------
    ground : Ground
        Its recipes, and the experience with them.
    scaled : callable
        The scaled problem on the box as it is now; for estimates.
    share : float
        Share of the progress that the last rung makes as a rule.
    """

    ground: Ground
    scaled: Callable[[], Scaled]
    share: float = 0.0
    recipes: list[Recipe] = field(init=False)

    def __post_init__(self) -> None:
        self.recipes = list(self.ground.recipes)

    def best(self, left: float | None) -> tuple[Recipe | None, float]:
        """The recipe worth most in a second, and that worth, among those that end in time."""
        best, most = None, 0.0
        for recipe in map(self._prepared, self.recipes):
            seconds = self.seconds(recipe)
            if not np.isfinite(seconds) or (left is not None and seconds > 2.0 * left):
                continue
            rate = self.ground.experience.rate(recipe, self.share, seconds)
            if rate > most:
                best, most = recipe, rate
        return best, most

    def climbed(self, recipe: Recipe) -> None:
        """Leave out a rung and those below it; on a tightened box it may be climbed again."""
        again = [recipe.tightened] if self._may_tighten(recipe) else []
        self.recipes = [*again, *(r for r in self.recipes if r.share > recipe.share)]
        self.share = recipe.share

    def again(self, recipes: Iterable[Recipe]) -> None:
        """Put rungs back that may do more on a smaller box."""
        self.recipes = [*recipes, *self.recipes]
        self.share = 0.0

    def seconds(self, recipe: Recipe) -> float:
        """Expected seconds: as seen before, else estimated at the pace of the other rungs."""
        seen, known = self.ground.experience, self.ground.estimates
        if recipe.name in seen.seconds:
            return seen.seconds[recipe.name]
        if recipe.plain is not None:
            return self._tightening + self.seconds(recipe.plain)
        if recipe.name not in known:
            known[recipe.name] = recipe.seconds(self.scaled(), self.ground.cliques)
        alone = seen.pace * known[recipe.name]
        if recipe.shape == "linear" and self.ground.narrow and not self.dear:
            return alone + self._tightening  # other programs follow the first
        return alone

    @property
    def shortest(self) -> float:
        """Expected seconds of the fastest relaxation that is not weak, +inf if none is left."""
        return min((self.seconds(r) for r in self.recipes if r.share > _WEAK), default=np.inf)

    @property
    def dear(self) -> bool:
        """Whether tightening by linear programs costs more than the next relaxation."""
        return self._tightening > _DEAR * self.shortest

    @property
    def _tightening(self) -> float:
        """Expected seconds of a few rounds of tightening."""
        seen = self.ground.experience.seconds
        programs = 2.0 * min(len(self.ground.variables), NARROW)
        return seen.get(TIGHTENING, programs * seen.get(PROGRAM, self._program))

    @property
    def _program(self) -> float:
        """Expected seconds of a linear program before any was solved."""
        known = self.ground.estimates
        if _LINEAR.name not in known:
            known[_LINEAR.name] = _LINEAR.seconds(self.scaled(), self.ground.cliques)
        return self.ground.experience.pace * known[_LINEAR.name]

    def _may_tighten(self, recipe: Recipe) -> bool:
        below = recipe.shape in _TIGHTENED and recipe.plain is None
        return self.ground.narrow and below and bool(self.ground.variables)

    def _prepared(self, recipe: Recipe) -> Recipe:
        """On a tightened box, where that costs less than failing without is expected to."""
        seen = self.ground.experience.seconds
        if not self._may_tighten(recipe) or not {PROGRAM, TIGHTENING} & seen.keys():
            return recipe
        alone = self.seconds(recipe)
        both = self._tightening + alone
        fails = 1.0 - self.ground.experience.closes(recipe.name)
        return recipe.tightened if both < alone + fails * both else recipe


def worth_in_parts(
    tried: Iterable[tuple[Recipe, float, float]], gap: tuple[float, float], program: float
) -> Recipe | None:
    """The relaxation that closed most of a gap in a second, if cutting alone does not do more.

    Parameters
    ----------
    tried : iterable of (Recipe, bound, seconds)
    gap : (float, float)
        The bound without them, and the attained value.
    program : float
        Seconds of the linear programs of one part.
    """
    best, most = None, _LEVEL / program
    base, upper = gap
    for recipe, bound, seconds in tried:
        whole = upper - base
        closed = (bound - base) / whole if np.isfinite(whole) and whole > 0 else float(bound > base)
        # a share s needs about log(1 / (1 - s)) fewer levels of cuts
        worth = -np.log1p(-min(max(closed, 0.0), 0.999)) / max(seconds, 1e-3)
        if closed > 0.1 and worth > most:
            best, most = recipe, worth
    return best
