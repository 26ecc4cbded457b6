"""Result of a problem with ratios: status, proved bound, attained value."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.claims import Recomputed, proved_bound
from sparsepop_py.errors import ClaimError
from sparsepop_py.options import Options
from sparsepop_py.problem.rational_problem import Range, RationalProblem
from sparsepop_py.result import HistoryEntry, Result, Status, Summarised, claims_of, gap_of
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.rational_bound import RationalCertificate
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

if TYPE_CHECKING:
    from sparsepop_py.relaxation.moment import Relaxation

__all__ = ["RationalResult", "attained_value"]


def attained_value(
    problem: RationalProblem, ranges: list[Range], level: float | None, found: float
) -> float:
    """Bound the objective of a problem with ratios at a point of its polynomial problem.

    Parameters
    ----------
    problem : RationalProblem
    ranges : list of Range
    level : float or None
        As for :meth:`RationalProblem.lifted`.
    found : float
        The objective of the polynomial problem at the point, or more.

    Returns
    -------
    float
        Rounded upwards. With a level c: p / q = c + found / |q| at most.
    """
    if level is None or not np.isfinite(found):
        return found
    _, q = problem.single_ratio(level)
    size = ranges[problem.place(q)]
    part = Fraction(0)
    if found > 0:
        part = Fraction(found) / Fraction(size.least)
    elif np.isfinite(size.most):
        part = Fraction(found) / Fraction(size.most)
    constant = Fraction(problem.objective.whole.constant_term)
    return float(Interval.of_fraction(constant + Fraction(level) + part).hi)


@dataclass(frozen=True, eq=False, repr=False)
class RationalResult(Summarised, ReadOnly):
    """Result of :func:`sparsepop_py.solve` for a problem with ratios.

    Parameters
    ----------
    problem : RationalProblem
    options : Options
    status : Status
    lower_bound : float
        Proved: no feasible point has a smaller objective.
    upper_bound : float
        Attained: a feasible point with at most this objective provably exists.
    x : (n,) float or None
        The attained point, else the best nearly feasible one, else None.
    certificate : RationalCertificate
        The argument behind ``lower_bound``, with the signs of all denominators.
    attained : ProvedPoint or None
        The argument behind ``upper_bound``: a point of the polynomial problem
        ``problem.lifted(ranges, certificate.level)``; its first n coordinates are x.
    polynomial : Result or None
        Result of the polynomial problem; not stored in files.
    notes : tuple of str

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> f = 1 / (1 + x**2) + x * y / (1 + y**2)
    >>> result = sp.solve(sp.RationalProblem(f, lower=-1, upper=1))
    >>> result.status, abs(result.lower_bound) < 1e-6, result.certificate.verify(result.problem).ok
    (<Status.OPTIMAL: 'OPTIMAL'>, True, True)
    """

    problem: RationalProblem
    options: Options
    status: Status
    lower_bound: float
    upper_bound: float
    x: NDArray[np.float64] | None
    certificate: RationalCertificate
    attained: ProvedPoint | None
    polynomial: Result | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def gap(self) -> float:
        """``upper_bound - lower_bound``; inf when one of them is missing, 0 if infeasible."""
        return gap_of(self)

    @property
    def message(self) -> str:
        """Meaning of the status, in a sentence."""
        return self.status.message

    @property
    def relaxation(self) -> Relaxation | None:
        """The relaxation of the polynomial problem that was solved last."""
        return None if self.polynomial is None else self.polynomial.relaxation

    @property
    def history(self) -> tuple[HistoryEntry, ...]:
        """Steps of the search on the polynomial problem."""
        return () if self.polynomial is None else self.polynomial.history

    @property
    def timings(self) -> dict[str, float]:
        """CPU seconds of each stage on the polynomial problem."""
        return {} if self.polynomial is None else self.polynomial.timings

    def _evidence(self) -> Recomputed:
        proof, problem = self.certificate, self.problem
        proved, attained, point = proved_bound(proof, problem), np.inf, None
        ranges = proof.proved_ranges(problem)
        if isinstance(ranges, str):
            raise ClaimError(f"result.certificate: {ranges}")
        if self.attained is not None:
            lifted = problem.lifted(ranges, proof.level)
            point = self.attained.recheck(lifted)
            if point is not None:
                attained = attained_value(problem, ranges, proof.level, point.value)
                falls = self.status is Status.UNBOUNDED and proof.level is None
                ray = falling_ray(lifted, point) if falls else None
                attained = attained if ray is None else -np.inf
        return Recomputed(proved, attained, point)

    def summary(self) -> str:
        """Describe the result in a few lines of text.

        Returns
        -------
        str
        """
        lines = claims_of(self, self.status.message)
        for proof, q in list(zip(self.certificate.ranges, self.problem.denominators, strict=True))[
            :8
        ]:
            least = proof.below.bound
            up = proof.sign < 0
            end = rounded(-least if up else least, up, 12)
            side = f"<= {end}" if up else f">= {end}"
            lines.append(f"denominator   {str(q)[:60]} {side}  proved")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])
