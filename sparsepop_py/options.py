"""How to solve: one frozen class, stored in every result."""

from __future__ import annotations

import numbers
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .errors import ProblemError

__all__ = ["Options"]

_CHOICES = {
    "effort": ("plain", "presolve", "auto"),
    "gap_kind": ("absolute", "relative"),
    "chordal": ("min-degree", "mcs-m"),
    "refine": ("scipy", "ipopt", "none"),
}


@dataclass(frozen=True)
class Options:
    """Options of :func:`sparsepop_py.solve`.

    Parameters
    ----------
    order : int, optional
        Relaxation order; the least legal one when left out, raised to it when smaller.
    effort : {"presolve", "plain", "auto"}
        ``"plain"``: scaling and exactly the relaxation of that order. ``"presolve"``:
        finite boxes too, by interval propagation and an objective cut-off. ``"auto"``:
        presolve, and higher orders while the gap is open, starting at ``order``; each is
        far dearer than the last, so give a ``time_limit`` with it.
    gap : float
        The gap that counts as closed.
    gap_kind : {"relative", "absolute"}
        Relative gaps are divided by max(1, |attained value|).
    tolerance : float
        Largest violation, in the user's units, of points that are worth showing.
    sparse : bool
        Exploit correlative sparsity; False makes one clique of all variables.
    chordal : {"min-degree", "mcs-m"}
        How the sparsity graph is made chordal.
    solver : str
        ``"clarabel"``, ``"clarabel-moment"`` or ``"cvxpy:NAME"``.
    refine : {"scipy", "ipopt", "none"}
        Local search for attained points; ``"ipopt"`` needs the extra of that name.
    time_limit : float, optional
        Seconds of wall time. Each solver call gets what is left; the best proved state so
        far is returned, with status LIMIT where the gap is open.
    seed : int
        Seed of random starting points.
    progress : bool
        Whether to draw a progress line when a terminal is attached.

    Raises
    ------
    ProblemError
        If a value is outside its range; the message names the option.
    """

    order: int | None = None
    effort: Literal["plain", "presolve", "auto"] = "presolve"
    gap: float = 1e-6
    gap_kind: Literal["relative", "absolute"] = "relative"
    tolerance: float = 1e-6
    sparse: bool = True
    chordal: Literal["min-degree", "mcs-m"] = "min-degree"
    solver: str = "clarabel"
    refine: Literal["scipy", "ipopt", "none"] = "scipy"
    time_limit: float | None = None
    seed: int = 0
    progress: bool = False

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise ProblemError(
                    f"Options.{name}: found {getattr(self, name)!r}, expected one of "
                    + ", ".join(map(repr, choices))
                )
        if self.order is not None and (
            isinstance(self.order, bool)
            or not isinstance(self.order, numbers.Integral)
            or self.order < 1
        ):
            raise ProblemError(f"Options.order: found {self.order!r}, expected a positive integer")
        for name in ("gap", "tolerance"):
            value = getattr(self, name)
            if not isinstance(value, numbers.Real) or not float(value) >= 0:
                raise ProblemError(f"Options.{name}: found {value!r}, expected a number >= 0")
        self._check_kinds()

    def _check_kinds(self) -> None:
        limit = self.time_limit
        if limit is not None and (not isinstance(limit, numbers.Real) or not float(limit) > 0):
            raise ProblemError(f"Options.time_limit: found {limit!r}, expected seconds > 0")
        if not isinstance(self.solver, str):
            raise ProblemError(f"Options.solver: found {self.solver!r}, expected a name")
        if not isinstance(self.seed, numbers.Integral) or int(self.seed) < 0:
            raise ProblemError(f"Options.seed: found {self.seed!r}, expected an integer >= 0")
        for name in ("sparse", "progress"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise ProblemError(
                    f"Options.{name}: found {getattr(self, name)!r}, expected True or False"
                )
