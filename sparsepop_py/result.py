"""Result of a solve: status, proved bound, attained value, and the history of the search."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.budget import TOO_LARGE, TOO_LONG, TOO_MUCH
from sparsepop_py.claims import Recomputed, check_claims, proved_bound, raised
from sparsepop_py.errors import ClaimError
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import read_only
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.certificate.certificate import Certificate, Verdict
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from sparsepop_py.conic.program import ConicSolution
    from sparsepop_py.problem.rational_problem import RationalProblem
    from sparsepop_py.relaxation.moment import Relaxation

__all__ = ["INTERRUPTED", "HistoryEntry", "Point", "Result", "Status"]

INTERRUPTED = "interrupted: what is proved so far is kept"  # a note


class Status(StrEnum):
    """Outcome of a solve; ``message`` says what it means.

    :attr:`Result.message` says more: what happened in that run, and what to try after it.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> sp.Status.INFEASIBLE.message
    'It is proved that no point satisfies the constraints.'
    """

    OPTIMAL = "OPTIMAL"
    BOUNDED = "BOUNDED"
    UNPROVED = "UNPROVED"
    INFEASIBLE = "INFEASIBLE"
    UNBOUNDED = "UNBOUNDED"
    LIMIT = "LIMIT"
    INTERRUPTED = "INTERRUPTED"
    FAILED = "FAILED"

    @property
    def message(self) -> str:
        """One sentence of help."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OPTIMAL: "The proved bound and the attained value agree within the gap asked for.",
    Status.BOUNDED: "The bound is proved, the gap is open.",
    Status.UNPROVED: (
        "No finite bound is proved: for some variable no finite bounds are given or were found. "
        "The objective may even fall without limit, which is proved along straight lines only."
    ),
    Status.INFEASIBLE: "It is proved that no point satisfies the constraints.",
    Status.UNBOUNDED: "It is proved that the objective falls without limit along a feasible ray.",
    Status.LIMIT: "A limit ended the work; what is proved by then is kept, the gap is open.",
    Status.INTERRUPTED: "The user interrupted; what is proved by then is kept, the gap is open.",
    Status.FAILED: "The solver failed and nothing finite is proved.",
}


@dataclass(frozen=True, eq=False)
class Point(ReadOnly):
    """Nearly feasible vector, shown with its violation; nothing proved rests on it.

    Parameters
    ----------
    x : (n,) float
    value : float
        The objective at x, as evaluated in floating point.
    violation : float
        Largest violation of constraints and bounds at x, in the user's units.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> point = sp.solve(sp.Problem(x, lower=0, upper=1)).points[0]
    >>> point.x.tolist(), point.value, point.violation
    ([0.0], 0.0, 0.0)
    """

    x: NDArray[np.float64]
    value: float
    violation: float

    def __post_init__(self) -> None:
        self.__dict__["x"] = read_only(self.x, "f", "x")


@dataclass(frozen=True)
class HistoryEntry:
    """One step of the search, with the bounds known after it.

    Parameters
    ----------
    name : str
        The relaxation that was solved, or "branch".
    order : int
        Relaxation order, 0 where that means nothing.
    lower_bound, upper_bound : float
        Proved and attained so far.
    seconds : float
        CPU seconds spent on this step.
    largest_block : int
        Size of its largest semidefinite block.
    moments : int
        Number of moments of its relaxation.
    nodes : int
        Branch-and-bound nodes processed so far.
    """

    name: str
    order: int
    lower_bound: float
    upper_bound: float
    seconds: float
    largest_block: int
    moments: int
    nodes: int = 0


class Summarised(ABC):
    """Common part of results with and without ratios: how they are shown."""

    problem: Any
    status: Status
    lower_bound: float
    upper_bound: float

    @abstractmethod
    def summary(self) -> str:
        """Describe the result in a few lines of text."""

    @abstractmethod
    def _evidence(self) -> Recomputed:
        """Compute bound and attained value again, whatever is claimed."""

    def recomputed(self) -> Recomputed:
        """Compute bound and attained value again, without a solver.

        Returns
        -------
        Recomputed

        Raises
        ------
        ClaimError
            If the evidence proves less than the result claims.
        """
        found = self._evidence()
        check_claims(self, found.proved, found.attained)
        return found

    def settled(self) -> Self:
        """Take point and attained value as they are proved here, after another machine.

        Returns
        -------
        Result or RationalResult
            This one with claims that verification confirms to the last digit.

        Raises
        ------
        ClaimError
            If the evidence proves less than the result claims, rounding aside.
        """
        own: Any = self
        found = self._evidence()
        upper = raised(self.upper_bound, found.attained)
        made: Self = replace(own, upper_bound=upper, attained=found.point)
        check_claims(made, found.proved, found.attained)
        return made

    def verify(self, problem: Problem | RationalProblem | None = None) -> Verdict:
        """Compute all claims again, without a solver: bounds, attained point and status.

        Parameters
        ----------
        problem : Problem or RationalProblem, optional
            What the result should be about; its own problem when left out.

        Returns
        -------
        Verdict
            True where every claim holds, with the lower bound that was computed, and with the
            reason where one does not. How far an optimal value may be off is :attr:`gap`.

        Examples
        --------
        >>> import sparsepop_py as sp
        >>> x, = sp.variables(1)
        >>> result = sp.solve(sp.Problem(x**2 - x, lower=0, upper=2))
        >>> bool(result.verify())
        True
        >>> result.verify(sp.Problem(x**2, lower=0, upper=2)).reason
        'the result belongs to another problem'
        """
        own = type(self.problem)
        if problem is not None and not isinstance(problem, own):
            found = type(problem).__name__
            return Verdict(False, -np.inf, f"found {found}, expected a {own.__name__}")
        if problem is not None and problem.fingerprint != self.problem.fingerprint:
            return Verdict(False, -np.inf, "the result belongs to another problem")
        try:
            return Verdict(True, self.recomputed().proved, "")
        except ClaimError as error:
            return Verdict(False, -np.inf, str(error))

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        low = rounded(self.lower_bound, False)
        high = rounded(self.upper_bound, True)
        return f"<{type(self).__name__} {self.status}: {low} <= minimum <= {high}>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.summary())}</pre>"


def gap_of(result: Summarised) -> float:
    """Compute the gap: inf when a bound is missing, 0 if infeasible."""
    if result.status is Status.INFEASIBLE:
        return 0.0
    gap = result.upper_bound - result.lower_bound
    return max(0.0, gap) if np.isfinite(gap) else np.inf


@dataclass(frozen=True, eq=False, repr=False)
class Result(Summarised, ReadOnly):
    """Result of :func:`sparsepop_py.solve`.

    Parameters
    ----------
    problem : Problem
    options : Options
    status : Status
    lower_bound : float
        Proved: no feasible point has a smaller objective. -inf when nothing is proved,
        +inf when no point is feasible.
    upper_bound : float
        Attained: a feasible point with at most this objective provably exists. +inf when
        none was proved.
    x : (n,) float or None
        The attained point, else the best nearly feasible one, else None.
    certificate : Certificate or None
        The argument behind ``lower_bound``.
    attained : ProvedPoint or None
        The argument behind ``upper_bound``.
    points : tuple of Point
        Distinct candidate minimisers, best first.
    relaxation : Relaxation or None
        The relaxation solved last.
    solution : ConicSolution or None
        Output of the conic solver (scaled units; no value in it is a bound).
    solver_value : float
        The solver's value in the units of the objective: no bound.
    history : tuple of HistoryEntry
        One entry for each step: a relaxation, or a slice of branch and bound.
    timings : dict of str to float
        CPU seconds of each stage.
    notes : tuple of str
        Sentences on what was changed or observed.
    moments : (n,) float or None
        Moments of degree one of the last relaxation, in the units of the variables: its guess at
        a minimiser, mostly not feasible. Not stored in files.
    ray : (n,) float or None
        With status ``UNBOUNDED`` the direction along which the objective falls from ``attained``.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> result = sp.solve(sp.Problem(x + y, [x**2 + y**2 <= 1]))
    >>> result.status, abs(result.lower_bound + 2**0.5) < 1e-5
    (<Status.OPTIMAL: 'OPTIMAL'>, True)
    """

    problem: Problem
    options: Options
    status: Status
    lower_bound: float
    upper_bound: float
    x: NDArray[np.float64] | None
    certificate: Certificate | None
    attained: ProvedPoint | None
    points: tuple[Point, ...]
    relaxation: Relaxation | None
    solution: ConicSolution | None
    solver_value: float
    history: tuple[HistoryEntry, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    moments: NDArray[np.float64] | None = None
    ray: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if self.certificate is not None and self.certificate.problem is not self.problem:
            about = replace(self.certificate, problem=self.problem)
            object.__setattr__(self, "certificate", about)

    @property
    def gap(self) -> float:
        """``upper_bound - lower_bound``; inf when one of them is missing, 0 if infeasible."""
        return gap_of(self)

    @property
    def message(self) -> str:
        """Meaning of the status in this run, and what to try after it."""
        if self.status is Status.UNBOUNDED and self.ray is not None:
            return f"It is proved that the objective falls without limit along {_line(self)}."
        if self.status is Status.LIMIT:
            found = "the bound is proved, the gap is open"
            if self.lower_bound == -np.inf:
                found = "nothing finite was proved by then"
            if any(TOO_LONG in note or TOO_MUCH in note for note in self.notes):
                return f"{_limits(self.options)} is too short for what the notes name; {found}."
            return f"{_limits(self.options)} ended the work; {found}."
        advice = _advice(self) if self.status in _OPEN else []
        meaning = _meaning(self)
        return f"{meaning} Try {_listed(advice)}." if advice else meaning

    def _evidence(self) -> Recomputed:
        proved, attained, point = -np.inf, np.inf, None
        if self.certificate is not None:
            proved = proved_bound(self.certificate, self.problem)
        if self.attained is not None:
            point = self.attained.recheck(self.problem)
        if point is not None:
            falls = self.status is Status.UNBOUNDED
            ray = falling_ray(self.problem, point, self.ray) if falls else None
            attained = point.value if ray is None else -np.inf
        return Recomputed(proved, attained, point)

    def summary(self) -> str:
        """Describe the result in a few lines of text.

        Returns
        -------
        str
            Status, bounds, point, sizes, history, seconds and notes.
        """
        lines = claims_of(self, self.message)
        if self.x is not None and self.attained is None:
            lines.append(
                f"              violates by {rounded(self.problem.violation(self.x), True, 2)}"
            )
        if self.certificate is not None:
            lines.append(
                f"correction    {rounded(self.certificate.correction, True, 3)}  paid for the proof"
            )
        if self.relaxation is not None:
            lines.append(str(self.relaxation))
        for entry in self.history if len(self.history) > 1 else ():
            low = rounded(entry.lower_bound, False, 8)
            nodes = f", {entry.nodes} nodes" if entry.nodes else ""
            lines.append(f"  {entry.name}: >= {low}, {entry.seconds:.2f} CPU seconds{nodes}")
        if self.timings:
            stages = ", ".join(f"{name} {sec:.2f}" for name, sec in self.timings.items())
            lines.append(f"CPU seconds   {stages}")
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)

    def history_table(self) -> str:
        """Format the history as a Markdown table: bounds, gap, seconds and sizes.

        Returns
        -------
        str
            One row for each entry of ``history``.
        """
        head = "| step | lower bound | attained | gap | CPU s | largest block | moments | nodes |"
        lines = [head, "|" + "---|" * 8]
        for entry in self.history:
            low = rounded(entry.lower_bound, False, 9)
            high = rounded(entry.upper_bound, True, 9)
            gap = max(0.0, entry.upper_bound - entry.lower_bound)
            lines.append(
                f"| {entry.name} | {low} | {high} | {gap:.2g} | {entry.seconds:.2f} "
                f"| {entry.largest_block} | {entry.moments} | {entry.nodes} |"
            )
        return "\n".join(lines)

    def plot_history(self, ax: Any = None) -> Axes:
        """Plot the gap against CPU seconds, one marker for each step.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; those of a new figure when left out.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        SolverNotFound
            If matplotlib is not installed.
        """
        from sparsepop_py.plots import plot_history

        return plot_history(self, ax)

    def plot(self, ax: Any = None) -> Axes:
        """Plot contours, feasible set and points in two dimensions, else the block pattern.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; those of a new figure when left out.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        SolverNotFound
            If matplotlib is not installed.
        """
        from sparsepop_py.plots import plot_result

        return plot_result(self, ax)


_ROUNDING = 1e-12  # a relative gap: smaller ones may be nothing else
_OPEN = (Status.BOUNDED, Status.UNPROVED, Status.FAILED)


def _line(result: Result) -> str:
    """Write a falling ray with the names of the variables that move."""
    assert result.ray is not None
    moving = np.flatnonzero(result.ray).tolist()
    steps = [f"{result.problem.names[v]} by {result.ray[v]:+g}" for v in moving[:8]]
    more = f", ... ({len(moving)} variables)" if len(moving) > 8 else ""
    return f"the ray from x that changes {', '.join(steps)}{more}"


def _limits(options: Options) -> str:
    """Name the limits of a run."""
    given = (
        ("time limit", options.time_limit, " s"),
        ("CPU limit", options.cpu_limit, " s"),
        ("work limit", options.work_limit, ""),
        ("node limit", options.node_limit, ""),
    )
    named = [f"{name} of {value:g}{unit}" for name, value, unit in given if value is not None]
    return "The " + " or the ".join(named) if named else "A limit"


def _meaning(result: Result) -> str:
    """Return the sentence of a status, for UNPROVED why nothing is proved."""
    if result.status is Status.UNPROVED and _too_large(result):
        return "No finite bound is proved: the relaxation is too large, as the notes say."
    if result.status is Status.UNPROVED and not result.history and result.solution is None:
        return "Nothing is proved, since no relaxation was solved."
    return result.status.message


def _too_large(result: Result) -> bool:
    return any(TOO_LARGE in note for note in result.notes)


def _advice(result: Result) -> list[str]:
    """List what to try after a run that left the gap open."""
    options, found = result.options, []
    if options.effort == "plain" and options.switches is None:
        found.append("effort 'presolve'")
    if options.effort != "auto":
        found.append("effort 'auto'")
    if result.relaxation is not None and result.relaxation.order and options.effort != "auto":
        found.append(f"order {result.relaxation.order + 1}")
    if options.node_limit is not None and options.effort == "auto":
        found.append("a larger node_limit")
    if options.skip:
        found.append(f"without skip={list(options.skip)}")
    return found + _advice_on_points(result)


def _advice_on_points(result: Result) -> list[str]:
    """List what concerns bounds of variables, attained points and the gap asked for."""
    options = result.options
    if result.status is not Status.BOUNDED:
        problem = result.problem
        bounded = bool(np.all(np.isfinite(problem.lower) & np.isfinite(problem.upper)))
        bounds = "tighter bounds" if bounded else "lower and upper bounds"
        lower = ["a lower order"] if _too_large(result) and options.order is not None else []
        return [*lower, f"{bounds} of all variables, or the objective as squares"]
    if result.attained is None and options.refine == "none":
        return ["a local search (refine) for an attained point"]
    if result.attained is None:
        more = [] if options.search_limit is None else ["a larger search_limit"]
        return [*more, "another starting point, as no attained point is known"]
    if result.gap <= _ROUNDING:
        return ["a larger gap, as rounding is all that is left of it"]
    return ["tighter bounds on the variables"]


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def claims_of(result: Any, message: str) -> list[str]:
    """List problem, status, bounds and point of a result, a line each."""
    proved = "proved" if result.lower_bound > -np.inf else "nothing proved"
    lines = [
        repr(result.problem)[1:-1],
        f"status        {result.status}: {message}",
        f"lower bound   {rounded(result.lower_bound, False, 11)}  {proved}",
        f"upper bound   {rounded(result.upper_bound, True, 11)}  "
        + ("attained" if result.attained else "no attained point"),
        f"gap           {rounded(result.gap, True, 3)}",
    ]
    if result.problem.sense == "max":
        lines.append("              (of the negative of the objective that is maximised)")
    if result.x is not None:
        shown = ", ".join(f"{v:.8g}" for v in result.x[:8])
        more = f", ... ({result.x.size} entries)" if result.x.size > 8 else ""
        lines.append(f"x             ({shown}{more})")
    return lines
