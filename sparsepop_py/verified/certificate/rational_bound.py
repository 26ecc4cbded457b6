"""Certificates of problems with ratios: signs of denominators, then a polynomial problem.

Both are certificates of polynomial problems. On the base set B (polynomial constraints and
bounds) a certificate of sign * q with a bound b > 0 proves that q has this sign and
|q| >= b; one of -sign * q with a bound -B proves |q| <= B. With these ranges the problem
becomes the polynomial problem of :meth:`RationalProblem.lifted`: a point x of the base is
feasible if and only if (x, s) with s_i = 1 / q_i(x) is, and both have the same objective.

With a level c the objective is w + p / q, w a constant, and the polynomial problem is
sign(q) (p - c q). If that is at least b on all feasible points then

    p / q - c  =  sign(q) (p - c q) / |q|  >=  b / |q|,

which is at least b / least for b < 0, and at least b / most for b >= 0 (Dinkelbach 1967).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError, check_kind, entries_of
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import Range, RationalProblem
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Verdict

__all__ = ["RangeProof", "RationalCertificate", "level_bound"]

_FOREIGN = "the certificate belongs to another problem"
_NO_SIGN = "the sign of the denominator {} is not proved"


@dataclass(frozen=True, eq=False)
class RangeProof:
    """Proof that a denominator q has one sign on a set, and of its size.

    Parameters
    ----------
    sign : int
        1 or -1.
    below : Certificate
        Of sign * q: |q| is at least its bound.
    above : Certificate or None
        Of -sign * q: |q| is at most the negative of its bound. None without such a bound.

    Raises
    ------
    ProblemError
        If a part has another type.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> problem = sp.RationalProblem(x / (x - 5), lower=-1, upper=1)
    >>> proof = sp.solve(problem).certificate.ranges[0]
    >>> size = proof.prove(problem.base, x - 5)
    >>> size.sign, round(size.least, 9), round(size.most, 9)
    (-1, 4.0, 6.0)
    """

    sign: int
    below: Certificate
    above: Certificate | None = None

    def __post_init__(self) -> None:
        if type(self.sign) is not int or self.sign not in (1, -1):
            raise ProblemError(f"sign: found {self.sign!r}, expected 1 or -1")
        if not isinstance(self.below, Certificate):
            raise ProblemError(f"below: found {type(self.below).__name__}, expected a Certificate")
        if not isinstance(self.above, Certificate | None):
            raise ProblemError(f"above: found {type(self.above).__name__}, expected a Certificate")

    def prove(
        self, base: Problem, denominator: Polynomial, known: dict[Any, Any] | None = None
    ) -> Range | None:
        """Prove the range again.

        Parameters
        ----------
        base : Problem
            Its objective is ignored.
        denominator : Polynomial
        known : dict, optional
            As for :meth:`Certificate.verify`.

        Returns
        -------
        Range or None
            None where the sign does not follow. With ``least`` = inf the set is empty.

        Raises
        ------
        ProblemError
            If an argument is of another kind.
        """
        check_kind(base, Problem, "base")
        check_kind(denominator, Polynomial, "denominator")
        least = self._bound(self.below, base, denominator * float(self.sign), known)
        if not least > 0:
            return None
        most = np.inf
        if self.above is not None:
            most = -self._bound(self.above, base, denominator * -float(self.sign), known)
        return Range(self.sign, least, max(least, most))

    @staticmethod
    def _bound(
        proof: Certificate, base: Problem, objective: Polynomial, known: dict[Any, Any] | None
    ) -> float:
        """Return what is proved of an objective, at most what is claimed."""
        verdict = proof.verify(base.with_objective(objective), known)
        return proof.bound if verdict.ok else -np.inf


def level_bound(problem: RationalProblem, level: float, found: float, size: Range) -> float:
    """Bound w + p / q by a bound of sign(q) (p - level q).

    Parameters
    ----------
    problem : RationalProblem
    level : float
    found : float
        The bound of the polynomial objective; +inf where nothing is feasible.
    size : Range
        Of q.

    Returns
    -------
    float
        Rounded downwards.
    """
    if not np.isfinite(found):
        return found
    part = Fraction(0)
    if found < 0:
        part = Fraction(found) / Fraction(size.least)
    elif np.isfinite(size.most):
        part = Fraction(found) / Fraction(size.most)
    constant = problem.objective.whole.constant_term
    return float(Interval.of_fraction(Fraction(constant) + Fraction(level) + part).lo)


@dataclass(frozen=True, eq=False, repr=False)
class RationalCertificate:
    """Proof of a lower bound, or of infeasibility, of a problem with ratios.

    Parameters
    ----------
    fingerprint : str
        Of the :class:`RationalProblem` that the claim is about.
    bound : float
        The claim; +inf says that no point is feasible.
    ranges : tuple of RangeProof
        One for each denominator.
    level : float or None
        The number with which an objective of one ratio is compared.
    certificate : Certificate or None
        Of the polynomial problem that ranges and level make; None where it is not needed,
        because the base is empty, or nothing is claimed.

    Raises
    ------
    ProblemError
        If a part has another type.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> problem = sp.RationalProblem(x / (1 + x**2), lower=-3, upper=3)
    >>> certificate = sp.solve(problem).certificate
    >>> certificate.verify(problem).ok
    True
    """

    fingerprint: str
    bound: float
    ranges: tuple[RangeProof, ...]
    level: float | None = None
    certificate: Certificate | None = None

    def __post_init__(self) -> None:
        listed = entries_of(self.ranges, "ranges", "a list of RangeProof")
        self.__dict__["ranges"] = tuple(listed)
        for proof in self.ranges:
            if not isinstance(proof, RangeProof):
                raise ProblemError(f"ranges: found {type(proof).__name__}, expected a RangeProof")
        if not isinstance(self.fingerprint, str):
            raise ProblemError(f"fingerprint: found {self.fingerprint!r}, expected a string")
        if not isinstance(self.level, float | None):  # integers may be no doubles
            raise ProblemError(f"level: found {self.level!r}, expected a float")
        if not isinstance(self.certificate, Certificate | None):
            raise ProblemError(
                f"certificate: found {type(self.certificate).__name__}, expected a Certificate"
            )

    def verify(self, problem: RationalProblem, known: dict[Any, Any] | None = None) -> Verdict:
        """Recompute the bound from the problem's exact doubles, without any solver.

        Parameters
        ----------
        problem : RationalProblem
        known : dict, optional
            As for :meth:`Certificate.verify`.

        Returns
        -------
        Verdict
            ``ok`` is true exactly when the problem is the one that was certified, the signs
            of all denominators are proved, and the recomputed bound is at least the claim.
        """
        if not isinstance(problem, RationalProblem) or problem.fingerprint != self.fingerprint:
            return Verdict(False, -np.inf, _FOREIGN)
        bound, reason = self.recompute(problem, {} if known is None else known)
        if bound >= self.bound:
            return Verdict(True, bound, "")
        return Verdict(False, bound, reason or "the argument proves less than what is claimed")

    def proved_ranges(
        self, problem: RationalProblem, known: dict[Any, Any] | None = None
    ) -> list[Range] | str:
        """Prove the ranges of all denominators again.

        Parameters
        ----------
        problem : RationalProblem
        known : dict, optional

        Returns
        -------
        list of Range, or str
            A sentence where some range does not follow.

        Raises
        ------
        ProblemError
            If an argument is of another kind.
        """
        check_kind(problem, RationalProblem, "problem")
        if len(self.ranges) != len(problem.denominators):
            return "there are not as many ranges as denominators"
        found = []
        for proof, q in zip(self.ranges, problem.denominators, strict=True):
            size = proof.prove(problem.base, q, known)
            if size is None:
                return _NO_SIGN.format(q)
            found.append(size)
        return found

    def recompute(
        self, problem: RationalProblem, known: dict[Any, Any] | None = None
    ) -> tuple[float, str]:
        """Recompute the bound that the argument proves.

        Parameters
        ----------
        problem : RationalProblem
        known : dict, optional

        Returns
        -------
        bound : float
        reason : str
            Sentence on why the bound is weak; may be empty.
        """
        ranges = self.proved_ranges(problem, known)
        if isinstance(ranges, str):
            return -np.inf, ranges
        if any(size.least == np.inf for size in ranges):
            return np.inf, ""  # the base is empty
        if self.certificate is None:
            return -np.inf, "there is no certificate of the polynomial problem"
        if self.level is not None and not (problem.has_level and np.isfinite(self.level)):
            return -np.inf, "the level does not fit the objective"
        verdict = self.certificate.verify(problem.lifted(ranges, self.level), known)
        if not verdict.ok:
            return -np.inf, verdict.reason
        if self.level is None:
            return verdict.bound, ""
        _, q = problem.single_ratio(self.level)
        size = ranges[problem.place(q)]
        return level_bound(problem, self.level, verdict.bound, size), ""

    def __repr__(self) -> str:
        return f"<{self}>"

    def __str__(self) -> str:
        least = rounded(self.bound, False, 12)
        claim = "no feasible point" if self.bound == np.inf else f"objective >= {least}"
        how = "reciprocals as variables" if self.level is None else f"level {self.level:.12g}"
        return f"certificate: {claim}, {len(self.ranges)} signs of denominators, {how}"
