"""Result of an identification: proved intervals, attained points, and their evidence.

``outer`` always means *proved*: every parameter vector that is consistent with the data,
the structure, the noise bounds and the priors lies in it. ``inner`` always means
*attained*: consistent parameters with these values provably exist.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.feasible_set.feasible_set import FeasibleSet
from setid.proofs.evidence import EndProof, Evidence, Verification
from setid.proofs.intervals import IntervalStatus, ParameterInterval, overstated
from setid.proofs.parameter_box import ProvedBox
from setid.proofs.uniqueness.normalisation import Nonzero
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.proofs.verification import verify
from setid.result.holdout import Holdout
from sparsepop_py.result import INTERRUPTED

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from pathlib import Path

    from matplotlib.axes import Axes

    from setid.analysis.sensitivity import Sensitivity
    from setid.bands.comparison import Comparison
    from setid.bands.outputs import Mode, OutputBand
    from setid.bands.responses import FrequencyBand, Kind
    from setid.bands.steps import StepBand
    from setid.export.python_control import ControlModels
    from setid.feasible_points.best import BestMember, Goal
    from setid.feasible_points.centre import Central
    from setid.feasible_set.projections import Projection
    from setid.options import Options
    from setid.result.reports import Remarks

__all__ = ["Identification", "least_settled"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Identification(FeasibleSet):
    """Parameter uncertainty intervals of one record, and all that they rest on.

    A :class:`FeasibleSet` with the evidence for it.

    Parameters
    ----------
    formulation : Formulation
        Data, structure, noise, priors, and the problem that they make.
    intervals : mapping of str to ParameterInterval
        One a parameter, in the order of ``formulation.parameters``.
    problem : sparsepop_py.Problem
        The problem that the bounds are about: that of the formulation, on the box.
    options : Options
    assumptions : tuple of str
        What the conclusions take for granted.
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
        The box of the parameters from the data alone, with its proof; None where linear
        programs settle everything, or where rows of the data give none.
    bounds : tuple of sparsepop_py.LinearBound
        For linear problems: exact bounds of theta_1, -theta_1, theta_2, ...
    results : tuple of sparsepop_py.Result
        Otherwise: what the engine proved and attained of theta_1, -theta_1, theta_2, ..., in
        the units of :func:`setid.formulation.units.in_units`, powers of two.
    active : mapping of str to bool
        For each prior (as it describes itself), whether it holds with equality at some
        attained end of an interval.
    samples : tuple of (record, sample)
        Where the set is empty: the samples, from 0, whose rows contradict each other.
    timings : mapping of str to float
        CPU seconds of each stage.
    notes : tuple of str
        What was observed on the way.
    unbounded : Unbounded, optional
        What proves that parameters are unbounded.
    reference : Identification, optional
        For a structure without a normalisation: the result with the one that was used.
    nonzero : ParameterBox or CellBox, optional
        What proves that this normalisation excludes no consistent system.
    holdout : Holdout, optional
        What samples that were held out say of the noise bounds.
    fewer_priors : Identification, optional
        The result without priors that have unknowns of their own, where these intervals use it.
    driven : Identification, optional
        The result of rows with an offset of the equation, where the data bound no offset of the
        output.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> result = setid.identify(data, model, setid.Noise(equation=0.5))
    >>> result.intervals["a1"]
    a1 in [-0.523256, -0.345333], attained [-0.523255, -0.345334], certified
    >>> bool(result.verify(data))
    True
    """

    assumptions: tuple[str, ...] = ()
    box: ProvedBox | None = None
    bounds: tuple[sp.LinearBound, ...] = ()
    results: tuple[sp.Result, ...] = ()
    active: Mapping[str, bool] = field(default_factory=dict)
    samples: tuple[tuple[int, int], ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unbounded: Unbounded | None = None
    reference: Identification | None = None
    nonzero: Nonzero | None = None
    holdout: Holdout | None = None
    fewer_priors: Identification | None = None
    driven: Identification | None = None

    @property
    def status(self) -> IntervalStatus:
        """The least settled status of all parameters."""
        return least_settled(self.intervals)

    @property
    def interrupted(self) -> bool:
        """True if Ctrl-C ended the work that made it."""
        return INTERRUPTED in self.notes

    @property
    def evidence(self) -> Evidence:
        """The claims and all that they rest on, as :func:`setid.verify` checks them."""
        return Evidence(
            formulation=self.formulation,
            intervals=self.intervals,
            problem=self.problem,
            box=self.box,
            bounds=self.bounds,
            ends=tuple(EndProof(r.certificate, r.attained) for r in self.results),
            unbounded=self.unbounded,
            reference=None if self.reference is None else self.reference.evidence,
            nonzero=self.nonzero,
            fewer_priors=None if self.fewer_priors is None else self.fewer_priors.evidence,
            driven=None if self.driven is None else self.driven.evidence,
        )

    # ---- texts --------------------------------------------------------------------------

    def table(self) -> str:
        """Print intervals as text, one row a parameter; outer ends rounded outwards."""
        from setid.result.reports import table

        return table(self)

    def summary(self) -> str:
        """Print the table, what it rests on, and advice on wide or empty intervals."""
        from setid.result.reports import summary

        return summary(self, self._remarks())

    def _remarks(self) -> Remarks:
        """Remarks of texts and pages."""
        from setid.result.reports import Remarks

        held = () if self.holdout is None else (self.holdout.text,)
        return Remarks(self.active, self.samples, (*self.notes, *held), self.assumptions)

    def _repr_html_(self) -> str:
        from setid.result.reports import html

        return html(self, self._remarks())

    def binding(self) -> tuple[tuple[int, int, int], ...]:
        """List samples whose noise is at its bound where ends of intervals are attained.

        Returns
        -------
        tuple of (record, sample, count)
            Records count from 1 and samples from 0; the count says at how many attained ends. Most
            frequent first: these samples decide how wide the intervals are.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
        >>> result.binding()[0]
        (1, 2, 4)
        """
        from setid.result.reports import binding

        return binding(self)

    def verify(self, data: IOData | None = None) -> Verification:
        """Check every claim again from the data, without any solver.

        Parameters
        ----------
        data : IOData, optional
            The record, without samples that were held out; the one that was stored when left out.

        Returns
        -------
        Verification
            True where formulation, box, all outer ends and all attained ends hold, those of
            certified intervals agree, and what is said of samples that were held out holds.
        """
        verdict = verify(self.evidence, data)
        if verdict and (reason := overstated(self.intervals, self.options.tol)):
            return Verification(False, reason)
        if verdict and self.holdout is not None:
            return self.holdout.verify(self.formulation, self.intervals)
        return verdict

    # ---- files and tables ---------------------------------------------------------------

    def to_json(self) -> str:
        """Write the result with its evidence as JSON text.

        Returns
        -------
        str
            What :meth:`from_json` reads.

        Raises
        ------
        SetidError
            If structure, noise or priors hold functions, which have no text.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
        >>> setid.Identification.from_json(result.to_json()).intervals["a1"]
        a1 in [-0.523256, -0.345333], attained [-0.523255, -0.345334], certified
        """
        from setid.result.json_ import to_json

        return to_json(self)

    @classmethod
    def from_json(cls, text: str) -> Identification:
        """Read a result and verify every claim of it; no solver is run.

        Parameters
        ----------
        text : str
            As :meth:`to_json` makes it.

        Raises
        ------
        SetidError
            If the text is no result, or a claim in it does not follow from the record in it.
        """
        from setid.result.json_ import from_json

        return from_json(text)

    def to_frame(self) -> Any:
        """Return the intervals as a pandas DataFrame, one row a parameter.

        Returns
        -------
        pandas.DataFrame
            Columns ``outer_low``, ``outer_high`` (proved), ``inner_low``, ``inner_high``
            (attained, NaN where none is), ``width``, ``centre``, ``status``.

        Raises
        ------
        SolverNotFound
            If pandas is missing; the message says how to install it.
        """
        from setid.result.frames import to_frame

        return to_frame(self)

    def report(
        self,
        path: str | os.PathLike[str],
        validation: IOData | None = None,
        time_limit: float = 60.0,
    ) -> Path:
        """Write one self-contained page: data, assumptions, intervals, bands, how to verify.

        Parameters
        ----------
        path : path-like
            Of the page, HTML with its pictures and the stored result inside.
        validation : IOData, optional
            A record to compare with; that of the identification when left out.
        time_limit : float
            Seconds for estimates, bands and comparisons together; a smaller one widens bands.
            Where sets are wide they take all of it. A band whose time is over may take 5 seconds
            more, on long records longer; pictures and the verification come on top.

        Returns
        -------
        pathlib.Path

        Raises
        ------
        SolverNotFound
            If jinja2 or matplotlib is missing; the message says how to install them.

        Notes
        -----
        A line in the terminal says what is worked on, unless the options of the identification
        have ``progress=False``.
        """
        from setid.result.page import report

        return report(self, path, validation, time_limit)

    # ---- estimates ----------------------------------------------------------------------

    @property
    def centre(self) -> Central:
        """Middle of the outer box, consistent or not; see :func:`setid.central`."""
        from setid.feasible_points.centre import central

        return central(self)

    def error(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Bound worst-case errors (p,) of an estimate; see :func:`setid.worst_case_error`.

        Parameters
        ----------
        theta : array_like (p,)
            Any estimate, consistent or not.
        """
        from setid.feasible_points.centre import worst_case_error

        return worst_case_error(self, theta)

    @property
    def feasible(self) -> NDArray[np.float64]:
        """A consistent parameter vector (p,); see :func:`setid.feasible`."""
        from setid.feasible_points.members import feasible

        return feasible(self)

    def best(self, goal: Goal = "simulation", time_limit: float = 20.0) -> BestMember:
        """Choose a member that simulates or predicts the record best; see :func:`setid.best`.

        Parameters
        ----------
        goal : {"simulation", "prediction"}
        time_limit : float
            Seconds.
        """
        from setid.feasible_points.best import best

        return best(self, goal, time_limit)

    @property
    def projection(self) -> NDArray[np.float64]:
        """Parameters (p,) whose equations fit best; see :func:`setid.projection_estimate`."""
        from setid.feasible_points.members import projection_estimate

        return projection_estimate(self)

    def consistent(self, theta: ArrayLike | Mapping[str, float]) -> NDArray[np.float64] | None:
        """Find a proof that parameters are consistent with data, noise bounds and priors.

        Parameters
        ----------
        theta : array_like (p,) or mapping of names to numbers

        Returns
        -------
        (n,) float or None
            No truth value: a witness, all unknowns with the noise included, near which a
            consistent one provably exists with exactly these parameters; None where no proof was
            found, which does not prove that they are inconsistent.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
        >>> result.consistent([-0.45, 2.0]) is not None, result.consistent([0.0, 2.0]) is None
        (True, True)
        """
        from setid.feasible_points.witness import consistent

        return consistent(self.formulation, theta)

    def sensitivity(
        self,
        factors: Iterable[float] | None = None,
        executor: Executor | None = None,
        options: Options | None = None,
    ) -> Sensitivity:
        """Compute widths and signs as functions of the noise bounds; see :func:`setid.sensitivity`.

        Parameters
        ----------
        factors : iterable of float, optional
            On all noise bounds; 1 to 2 in six steps when left out.
        executor : concurrent.futures.Executor, optional
            Each factor is a task of its own.
        options : Options, optional
            ``time_limit`` is for all of it together; those of the result when left out.
        """
        from setid.analysis.sensitivity import FACTORS, sensitivity

        return sensitivity(self, FACTORS if factors is None else factors, options, executor)

    # ---- one-line delegations -----------------------------------------------------------

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the intervals, outer and inner; see :func:`setid.plots.intervals.plot_intervals`.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.intervals import plot_intervals

        return plot_intervals(self, ax)

    def bode(
        self,
        omega: ArrayLike | None = None,
        kind: Kind = "proved",
        output: int = 1,
        input: int = 1,
        *,
        time_limit: float = 20.0,
    ) -> FrequencyBand:
        """Bound gain and phase, for ``.plot()`` as a Bode diagram; see :func:`frequency_band`.

        Parameters
        ----------
        omega : array_like (F,), optional
            Frequencies in rad per unit of time; a grid up to the Nyquist frequency when left out.
        kind : {"proved", "sampled"}
        output, input : int
            Channels, from 1.
        time_limit : float
            Seconds for what is proved.
        """
        from setid.bands.responses import frequency_band

        return frequency_band(self, omega, kind, output, input, time_limit=time_limit)

    def nyquist(
        self,
        omega: ArrayLike | None = None,
        kind: Kind = "proved",
        output: int = 1,
        input: int = 1,
        *,
        time_limit: float = 20.0,
    ) -> FrequencyBand:
        """Bound the frequency response, for ``.plot()`` in the plane; see :func:`frequency_band`.

        Parameters
        ----------
        omega : array_like (F,), optional
            Frequencies in rad per unit of time; a grid up to the Nyquist frequency when left out.
        kind : {"proved", "sampled"}
        output, input : int
            Channels, from 1.
        time_limit : float
            Seconds for what is proved.
        """
        found = self.bode(omega, kind, output, input, time_limit=time_limit)
        return replace(found, view="nyquist")

    def nichols(
        self,
        omega: ArrayLike | None = None,
        kind: Kind = "proved",
        output: int = 1,
        input: int = 1,
        *,
        time_limit: float = 20.0,
    ) -> FrequencyBand:
        """Bound the response, for ``.plot()`` of gain over phase; see :func:`frequency_band`.

        Parameters
        ----------
        omega : array_like (F,), optional
            Frequencies in rad per unit of time; a grid up to the Nyquist frequency when left out.
        kind : {"proved", "sampled"}
        output, input : int
            Channels, from 1.
        time_limit : float
            Seconds for what is proved.
        """
        found = self.bode(omega, kind, output, input, time_limit=time_limit)
        return replace(found, view="nichols")

    def step(
        self,
        length: int = 50,
        kind: Kind = "proved",
        output: int = 1,
        input: int = 1,
        *,
        tolerance: float = 0.1,
        time_limit: float = 20.0,
        all_time: bool = False,
    ) -> StepBand:
        """Bound step responses, for ``.plot()``; see :func:`setid.step_band`.

        Parameters
        ----------
        length : int
            Number of samples.
        kind : {"proved", "sampled"}
        output, input : int
            Channels, from 1.
        tolerance : float
            Share of the attained width by which a proved band may reach beyond it on each side.
        time_limit : float
            Seconds in which that is tried.
        all_time : bool
            Whether to prove a range after the last sample too.
        """
        from setid.bands.steps import step_band

        return step_band(
            self,
            length,
            kind,
            output,
            input,
            tolerance=tolerance,
            time_limit=time_limit,
            all_time=all_time,
        )

    def fps(self, first: str, second: str, directions: int = 16) -> Projection:
        """Project the feasible parameter set on two parameters; see :func:`setid.project`.

        Parameters
        ----------
        first, second : str
            Names of parameters.
        directions : int
            Number of support directions, at least 4.
        """
        from setid.feasible_set.projections import project

        return project(self, first, second, directions)

    def simulate(
        self,
        data: IOData | None = None,
        kind: Kind | None = None,
        noise: Noise | None = None,
        *,
        tolerance: float = 0.1,
        time_limit: float = 20.0,
    ) -> OutputBand:
        """Simulate outputs for the inputs of a record, with bands; see :func:`setid.simulate_band`.

        Parameters
        ----------
        data : IOData, optional
            The identification record when left out.
        kind : {"proved", "sampled"}, optional
            Proved where that is possible when left out.
        noise : Noise, optional
            Of this record; that of the identification when left out.
        tolerance : float
            Share of the attained width by which a proved band may reach beyond it on each side.
        time_limit : float
            Seconds in which that is tried.
        """
        from setid.bands.outputs import simulate_band

        return simulate_band(self, data, kind, noise, tolerance=tolerance, time_limit=time_limit)

    def predict(
        self, data: IOData | None = None, noise: Noise | None = None, *, time_limit: float = 20.0
    ) -> OutputBand:
        """Predict one step, with bands; see :func:`setid.predict`.

        Parameters
        ----------
        data : IOData, optional
            The identification record when left out.
        noise : Noise, optional
            Of this record; that of the identification when left out.
        time_limit : float
            Seconds for linear programs.
        """
        from setid.bands.outputs import predict

        return predict(self, data, noise, time_limit=time_limit)

    def compare(
        self,
        validation: IOData | None = None,
        mode: Mode = "simulation",
        kind: Kind | None = None,
        noise: Noise | None = None,
        time_limit: float = 20.0,
    ) -> Comparison:
        """Compare with a record, by fit and guaranteed band; see :func:`setid.compare`.

        Parameters
        ----------
        validation : IOData, optional
            The identification record when left out.
        mode : {"simulation", "prediction"}
        kind : {"proved", "sampled"}, optional
            Proved where that is possible when left out.
        noise : Noise, optional
            Of this record; that of the identification when left out.
        time_limit : float
            Seconds for a proved band and the search for the best member.
        """
        from setid.bands.comparison import compare

        return compare(self, validation, mode, kind, noise, time_limit)

    def to_control(self, omega: ArrayLike | None = None, kind: Kind = "sampled") -> ControlModels:
        """Convert to models of python-control; see :func:`setid.to_control`.

        Parameters
        ----------
        omega : array_like (F,), optional
            Grid of frequencies.
        kind : {"sampled", "proved"}
        """
        from setid.export.python_control import to_control

        return to_control(self, omega, kind)

    @property
    def endless(self) -> Unbounded | None:
        """Deprecated name of ``unbounded``."""
        text = "Identification.endless is now Identification.unbounded"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return self.unbounded

    def __repr__(self) -> str:
        lines = [repr(interval) for interval in self.intervals.values()]
        return "<Identification: " + "; ".join(lines) + ">"


_WORST_FIRST = (
    IntervalStatus.EMPTY,
    IntervalStatus.UNIDENTIFIABLE,
    IntervalStatus.UNBOUNDED,
    IntervalStatus.PARTIAL,
    IntervalStatus.CERTIFIED,
)


def least_settled(intervals: Mapping[str, ParameterInterval]) -> IntervalStatus:
    """Choose the least settled status of some intervals, at least one."""
    found = {item.status for item in intervals.values()}
    return next(status for status in _WORST_FIRST if status in found)
