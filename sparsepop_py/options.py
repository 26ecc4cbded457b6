"""How to solve: one frozen class, stored in every result."""

from __future__ import annotations

import numbers
from dataclasses import dataclass
from typing import Literal

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
        presolve, and higher orders while the gap is open, starting at ``order``.
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
            not isinstance(self.order, numbers.Integral) or self.order < 1
        ):
            raise ProblemError(f"Options.order: found {self.order!r}, expected a positive integer")
        for name in ("gap", "tolerance"):
            value = getattr(self, name)
            if not isinstance(value, numbers.Real) or not float(value) >= 0:
                raise ProblemError(f"Options.{name}: found {value!r}, expected a number >= 0")
        if self.time_limit is not None and not self.time_limit > 0:
            raise ProblemError(
                f"Options.time_limit: found {self.time_limit!r}, expected seconds > 0"
            )
