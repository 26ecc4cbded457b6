"""Queue of relaxations, ordered by expected gap reduction per CPU second.

A relaxation whose bound depends on the box may be solved on a box that linear programs have
tightened first. With seconds t of tightening, s of the relaxation and a chance p that it
closes the gap without, that is expected to cost t + s against s + (1 - p) (t + s).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from sparsepop_py.budget import TOO_LONG
from sparsepop_py.relaxation.hierarchy import RelaxationSpec
from sparsepop_py.strategy.settings import BOUND_TIGHTENING, STRATEGY, TREE
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.verified.box.scaling import Scaled

__all__ = ["PROGRAM", "TIGHTENING", "RelaxationQueue", "relaxation_for_nodes"]

PROGRAM = "linear program"  # names under which the cost model keeps their seconds
TIGHTENING = "tightening"
_LINEAR = RelaxationSpec("linear", 0.0, "linear")
_TIGHTENED = ("star", "split", "mixed")
_SHORTEST = 1e-3  # seconds; shorter times count as this


@dataclass(eq=False)
class RelaxationQueue:
    """Relaxations that are left to try for one objective.

    Parameters
    ----------
    shared_state : SharedState
        Its relaxations, and the cost model that learns from them.
    scaled : callable
        Returns the problem scaled to the current box; for estimates.
    share : float
        Expected progress of the last relaxation, see :mod:`sparsepop_py.relaxation.hierarchy`.
    specs : list of RelaxationSpec
        Those that are left.
    expected : dict of str to float
        By name, the most that relaxations which were put back are expected to gain.
    """

    shared_state: SharedState
    scaled: Callable[[], Scaled]
    share: float = 0.0
    specs: list[RelaxationSpec] = field(init=False)
    expected: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.specs = list(self.shared_state.specs)

    def best(self, seconds_left: float | None) -> tuple[RelaxationSpec | None, float]:
        """Select the relaxation with the largest expected gain per second.

        Parameters
        ----------
        seconds_left : float or None
            CPU seconds that are expected to be left; relaxations expected to take over twice as
            long are left out. Linear programs prove something when they are stopped, and may take
            far longer.

        Returns
        -------
        spec : RelaxationSpec or None
            None where nothing is left.
        rate : float
            Its expected gain per second.
        """
        best, most = None, 0.0
        for spec in map(self._prepared, self.specs):
            seconds = self.seconds(spec)
            if not np.isfinite(seconds) or self._too_long(spec, seconds, seconds_left):
                continue
            rate = self.shared_state.cost_model.rate(spec, self.share, seconds)
            if spec.name in self.expected:
                rate = min(rate, self.expected[spec.name] / max(_SHORTEST, seconds))
            if rate > most:
                best, most = spec, rate
        return best, most

    def next_order(
        self, best: RelaxationSpec | None, seconds_left: float | None
    ) -> RelaxationSpec | None:
        """Select the next relaxation order where it should come before all else.

        What an order proves is hardly known before, and a cheap one that closes the gap saves what
        seems to gain more per second. One that surely ends in time comes before one that may not.
        Before the first relaxation no order is next: others that cost less prove more than the
        least one.

        Parameters
        ----------
        best : RelaxationSpec or None
            The relaxation with the largest expected gain per second.
        seconds_left : float or None
            CPU seconds that are expected to be left.

        Returns
        -------
        RelaxationSpec or None
        """
        orders = [r for r in self.specs if r.whole and r.share > self.share]
        spec = min(orders, key=lambda r: r.share, default=None)
        if self.share == 0.0 or spec is None:
            return None
        seconds = self.seconds(spec)
        most = STRATEGY.cheap_seconds
        if best is not None and seconds_left is not None:
            sure = STRATEGY.sure_time_share * seconds_left
            most = max(most, sure) if self.seconds(best) > sure else most
        return None if seconds > most or self._too_long(spec, seconds, seconds_left) else spec

    def _too_long(self, spec: RelaxationSpec, seconds: float, seconds_left: float | None) -> bool:
        if seconds_left is None:
            return False
        if spec.shape == "linear" and spec.name not in self.shared_state.cost_model.seconds:
            return self._program > STRATEGY.program_overtime * seconds_left
        return seconds > STRATEGY.most_overtime * seconds_left

    def set_expected_seconds(self, spec: RelaxationSpec, seconds: float) -> None:
        """Set the expected seconds of a relaxation that was built and not solved."""
        self.shared_state.estimates[spec.name] = seconds

    def left_out(self, seconds_left: float | None) -> tuple[str, bool]:
        """Describe the relaxations that time or memory do not allow.

        Returns
        -------
        text : str
            Empty without any.
        slow : bool
            Whether there are some that time does not allow.
        """
        slow, large = [], []
        for spec in self.specs:
            seconds = self.seconds(spec)
            if not np.isfinite(seconds):
                large.append(spec.name)
            elif self._too_long(spec, seconds, seconds_left):
                slow.append(f"{spec.name} (about {seconds:.2g} s)")
        parts = [f"{TOO_LONG}: {', '.join(slow)}"] if slow else []
        parts += [f"too large for the memory limit: {', '.join(large)}"] if large else []
        return f"relaxations not tried: {'; '.join(parts)}" if parts else "", bool(slow)

    def remove_up_to(self, spec: RelaxationSpec) -> None:
        """Remove a relaxation and all weaker ones; it may return on a tightened box."""
        tightened = [spec.tightened] if self._may_tighten(spec) else []
        self.specs = [*tightened, *(r for r in self.specs if r.share > spec.share)]
        self.share = spec.share

    def requeue(self, specs: Iterable[RelaxationSpec], worth: float = np.inf) -> None:
        """Put relaxations back that may prove more on a smaller box.

        Parameters
        ----------
        specs : iterable of RelaxationSpec
        worth : float
            Their worth is expected to be this at most, see :meth:`CostModel.learn`.
        """
        returned = list(specs)
        self.specs = [*returned, *self.specs]
        self.expected |= {spec.name: worth for spec in returned}
        self.share = 0.0

    def seconds(self, spec: RelaxationSpec) -> float:
        """Estimate the seconds of a relaxation, from earlier solves where there are any."""
        seen, known = self.shared_state.cost_model, self.shared_state.estimates
        if spec.name in seen.seconds:
            return seen.seconds[spec.name]
        if spec.plain is not None:
            return self._tightening + self.seconds(spec.plain)
        if spec.name not in known:
            known[spec.name] = spec.seconds(self.scaled(), self.shared_state.cliques)
        alone = seen.pace * known[spec.name]
        if spec.shape == "linear" and self.shared_state.obbt_lp and not self.obbt_too_slow:
            return alone + self._tightening  # other programs follow the first
        return alone

    @property
    def shortest(self) -> float:
        """Expected seconds of the fastest relaxation that is not weak, +inf if none is left."""
        strong = (spec for spec in self.specs if spec.share > STRATEGY.weak_progress)
        return min(map(self.seconds, strong), default=np.inf)

    @property
    def obbt_too_slow(self) -> bool:
        """True if tightening by linear programs costs more than the next relaxation."""
        return self._tightening > BOUND_TIGHTENING.too_slow * self.shortest

    @property
    def _tightening(self) -> float:
        """Expected seconds of a few rounds of OBBT by linear programs."""
        seen = self.shared_state.cost_model.seconds
        programs = 2.0 * min(len(self.shared_state.variables), BOUND_TIGHTENING.most_variables)
        return seen.get(TIGHTENING, programs * seen.get(PROGRAM, self._program))

    @property
    def _program(self) -> float:
        """Expected seconds of a linear program before any was solved."""
        known = self.shared_state.estimates
        if _LINEAR.name not in known:
            known[_LINEAR.name] = _LINEAR.seconds(self.scaled(), self.shared_state.cliques)
        return self.shared_state.cost_model.pace * known[_LINEAR.name]

    def _may_tighten(self, spec: RelaxationSpec) -> bool:
        below = spec.shape in _TIGHTENED and spec.plain is None
        return self.shared_state.obbt_lp and below and bool(self.shared_state.variables)

    def _prepared(self, spec: RelaxationSpec) -> RelaxationSpec:
        """Choose the tightened form where it costs less than failing without is expected to."""
        seen = self.shared_state.cost_model.seconds
        if not self._may_tighten(spec) or not {PROGRAM, TIGHTENING} & seen.keys():
            return spec
        alone = self.seconds(spec)
        both = self._tightening + alone
        fails = 1.0 - self.shared_state.cost_model.closes(spec.name)
        return spec.tightened if both < alone + fails * both else spec


def relaxation_for_nodes(
    tried: Iterable[tuple[RelaxationSpec, float, float]], gap: tuple[float, float], program: float
) -> RelaxationSpec | None:
    """Select the relaxation for nodes: the best per second, if better than branching alone.

    Parameters
    ----------
    tried : iterable of (RelaxationSpec, bound, seconds)
        Relaxations of the root.
    gap : (float, float)
        The bound without them, and the attained value.
    program : float
        Seconds of the linear programs of one node.

    Returns
    -------
    RelaxationSpec or None
    """
    best, most = None, TREE.node_gain / max(program, _SHORTEST)
    base, upper = gap
    for spec, bound, seconds in tried:
        whole = upper - base
        closed = (bound - base) / whole if np.isfinite(whole) and whole > 0 else float(bound > base)
        # a share s saves about log(1 / (1 - s)) levels of the tree
        worth = -np.log1p(-min(max(closed, 0.0), 0.999)) / max(seconds, _SHORTEST)
        if closed > 0.1 and worth > most:
            best, most = spec, worth
    return best
