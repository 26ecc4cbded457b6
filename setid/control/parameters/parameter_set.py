"""A polytope that provably contains every consistent parameter vector, made from sums of rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import comb, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import setid
from setid.control.engine import (
    Box,
    Formulation,
    Given,
    Identification,
    IOData,
    Noise,
    Options,
    Stable,
    TransferFunction,
    frozen,
    identify,
    parameters,
)
from setid.control.parameters.polytope import Polytope
from setid.control.parameters.rows import NoisyRows, noisy_rows
from setid.control.parameters.sums import (
    Frame,
    best_fit,
    cover_by_sums,
    first_box,
    in_time,
    within_doubles,
)
from setid.priors.stability import rounded_up
from sparsepop_py.budget import LimitReached

__all__ = ["ParameterSet", "consistent_set"]

Reals = NDArray[np.float64]
_EPS = 2.0**-52
_WINDOW = 300  # samples of a box from rows one by one


@dataclass(frozen=True, eq=False)
class ParameterSet:
    """The vectors theta = offset + basis (origin + axes z) with z in a polytope.

    Parameters
    ----------
    rows : NoisyRows
        What the record says of theta.
    frame : Frame
    polytope : Polytope
        In z. Contains the z of every consistent theta.
    """

    rows: NoisyRows
    frame: Frame
    polytope: Polytope

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.rows.names

    @property
    def empty(self) -> bool:
        """True if it is proved that nothing is consistent."""
        return bool(np.any(self.polytope.lower > self.polytope.upper))

    def theta(self, z: Reals) -> Reals:
        """Compute parameters (p,) at z (q,), in doubles."""
        x = self.frame.origin + self.frame.axes @ z
        return np.asarray(self.rows.offset + self.rows.basis @ x, np.float64)

    @property
    def centre(self) -> Reals:
        """Parameters (p,) in the middle of the polytope's box."""
        return self.theta(self.polytope.centre)

    def in_frame(
        self, constants: NDArray[Any], weights: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], Reals]:
        """Write functions constants + weights theta as functions of z.

        Parameters
        ----------
        constants, weights : (K,), (K, p) float or complex

        Returns
        -------
        constants, directions : (K,), (K, q)
        loss : (K,) float
            Bound of the rounding errors of both, over the polytope.
        """
        rows, frame = self.rows, self.frame
        free = weights @ rows.basis
        found = constants + weights @ rows.offset + free @ frame.origin
        size, basis = np.abs(weights), np.abs(rows.basis)
        reach = np.abs(frame.origin) + np.abs(frame.axes) @ self.polytope.magnitude
        total = np.abs(constants) + size @ (np.abs(rows.offset) + basis @ reach)
        return found, free @ frame.axes, 8 * (rows.offset.size + 8) * _EPS * total

    def ranges(self, constants: Reals, weights: Reals) -> tuple[Reals, Reals]:
        """Bound values (K,) of constants (K,) + weights (K, p) theta from both sides."""
        constant, directions, loss = self.in_frame(constants, weights)
        low, high = self.polytope.ranges(directions)
        slack = loss + 4 * _EPS * (np.abs(constant) + np.maximum(np.abs(low), np.abs(high)))
        return constant + low - slack, constant + high + slack

    def exact_ranges(self, weights: Sequence[Sequence[Fraction]]) -> tuple[Reals, Reals]:
        """Bound values (K,) of weights (K, p) theta from both sides, weights that are no doubles.

        Their rounding is paid for by the largest absolute values of the parameters.
        """
        rounded = np.array([[_double(c) for c in row] for row in weights])
        low, high = self.ranges(np.zeros(len(rounded)), rounded)
        for place, (row, near) in enumerate(zip(weights, rounded.tolist(), strict=True)):
            errors = [abs(c - Fraction(r)) for c, r in zip(row, near, strict=True)]
            parts = [(e, r) for e, r in zip(errors, self._reach, strict=True) if e]
            if parts:
                loss = inf
                if all(r < inf for _, r in parts):
                    loss = rounded_up(sum((e * Fraction(r) for e, r in parts), Fraction()))
                low[place] = np.nextafter(low[place] - loss, -inf)
                high[place] = np.nextafter(high[place] + loss, inf)
        return low, high

    @cached_property
    def _reach(self) -> list[float]:
        """Largest absolute values (p,) of the parameters, by proof."""
        return [max(abs(a), abs(b)) for a, b in zip(*(e.tolist() for e in self.box), strict=True)]

    @property
    def box(self) -> tuple[Reals, Reals]:
        """Proved lower and upper ends (p,) of the parameters."""
        p = len(self.names)
        return self.ranges(np.zeros(p), np.eye(p))

    def within(
        self, matrix: Reals, right: Reals, until: float = inf, brief: bool = False
    ) -> ParameterSet:
        """Take the part in which matrix theta <= right, shrunk again.

        Parameters
        ----------
        matrix, right : (m, p), (m,) float
        until : float
            Reading of ``time.monotonic`` that ends it by ``LimitReached``.
        brief : bool
            As for :func:`consistent_set`.
        """
        constant, directions, loss = self.in_frame(np.zeros(len(right)), matrix)
        size = np.abs(right) + np.abs(constant)
        smaller = self.polytope.with_rows(directions, right - constant + loss + 4 * _EPS * size)
        return self.shrunk(smaller, until, brief)

    def halves(self, axis: int) -> list[ParameterSet]:
        """Halve the set at the middle of a coordinate z, empty parts left out."""
        found, old = [], self.polytope.essential()
        for side in (0, 1):
            low, high = old.lower.copy(), old.upper.copy()
            (high if side == 0 else low)[axis] = old.centre[axis]
            part = Polytope(low, high, old.matrix, old.right)
            fit = self.frame.origin + self.frame.axes @ part.centre
            smaller = self.part(cover_by_sums(self.rows, part, self.frame, fit, 3))
            if not smaller.empty:
                found.append(smaller)
        return found

    def shrunk(self, polytope: Polytope, until: float = inf, brief: bool = False) -> ParameterSet:
        """Keep rows and frame over what sums of rows leave of another polytope."""
        parts = self.rows, polytope, self.frame
        return self.part(cover_by_sums(*parts, until=until, best=not brief))

    def part(self, polytope: Polytope) -> ParameterSet:
        """Keep rows and frame over another polytope."""
        return ParameterSet(self.rows, self.frame, polytope)


def _double(value: Fraction) -> float:
    """Round to a double; to 0 beyond all doubles, so that all of it is an error."""
    try:
        return float(value)
    except OverflowError:
        return 0.0


def consistent_set(
    data: IOData,
    model: TransferFunction,
    noise: Noise,
    integrators: int = 0,
    margin: float | None = None,
    box: tuple[Reals, Reals] | None = None,
    until: float = inf,
    brief: bool = False,
) -> ParameterSet | None:
    """Prove a polytope around all consistent parameters, by linear programs alone.

    Parameters
    ----------
    data : IOData
    model : TransferFunction
        One input, one output.
    noise : Noise
    integrators : int
        Poles at exactly z = 1, 0 or 1.
    margin : float, optional
        Assumption: the other poles have abs(z) <= 1 - margin.
    box : (lower, upper), each (p,), optional
        Proved ends of all parameters, to start from where sums of rows give none.
    until : float
        Reading of ``time.monotonic`` after which the brief set is taken instead, so that a clock
        only chooses between two sets.
    brief : bool
        Make do without linear programs that look for the weights of sums.

    Returns
    -------
    ParameterSet or None
        None where the data give no finite polytope: the noise is strong, or squares of the
        signals are no doubles.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid.control.parameters.parameter_set import consistent_set
    >>> u = np.random.default_rng(0).uniform(-1, 1, 40)
    >>> model = setid.TransferFunction(1, 1, nk=1)
    >>> data = setid.IOData(u, setid.simulate(model, [-0.5, 1.0], u))
    >>> found = consistent_set(data, model, setid.Noise(output=0.01))
    >>> low, high = found.box
    >>> bool(np.all(low < [-0.5, 1.0]) and np.all([-0.5, 1.0] < high) and np.all(high - low < 0.05))
    True
    """
    rows = noisy_rows(data, model, noise, integrators)
    if rows.target.size < rows.basis.shape[1] or not rows.squarable:
        return None

    def covered(until: float, brief: bool) -> ParameterSet | None:
        frame = best_fit(rows)
        start = first_box(rows, frame, until, best=not brief)
        if start is None and (box is not None or not brief):
            start = _start(data, model, noise, margin, rows, frame, box, until)
        if start is None:
            return None
        found = ParameterSet(rows, frame, start)
        prior = _stable_rows(model, integrators, margin)
        if prior is not None:
            return found.within(*prior, until, brief)
        return found.shrunk(start, until, brief)

    if not brief:
        try:
            return within_doubles(lambda: covered(until, False))
        except LimitReached:
            pass
    return within_doubles(lambda: covered(inf, True))


def _start(
    data: IOData,
    model: TransferFunction,
    noise: Noise,
    margin: float | None,
    rows: NoisyRows,
    frame: Frame,
    known: tuple[Reals, Reals] | None,
    until: float,
) -> Polytope | None:
    """A polytope from a known box, or from that which rows and the margin give."""
    free = (np.count_nonzero(rows.basis, axis=1) == 1) & (rows.offset == 0.0)
    kept = np.flatnonzero(free)  # the others follow from an integrator
    if known is not None:
        return frame.box_around(known[0][kept], known[1][kept])
    if data.records == 1 and data.samples > _WINDOW:  # rows left out only enlarge the box
        output, input_, equation = (bound[:_WINDOW] for bound in noise.bounds(data))
        data, noise = data.split(_WINDOW)[0], Noise(output, input_, equation)
    formulation: Formulation = setid.formulate(data, model, noise)
    p = len(model.parameters)
    begin = np.array([np.full(p, -np.inf), np.full(p, np.inf)])
    na = model.na[0][0]
    if margin is not None:
        size = np.array([comb(na, i) for i in range(1, na + 1)], float)
        begin[:, :na] = -size, size
    if formulation.regression is None:
        return None
    box = setid.parameter_box(formulation.regression, begin, until)
    in_time(until)
    low, high = box.lower[kept], box.upper[kept]
    if np.any(low > high) or not np.all(np.isfinite([low, high])):
        return None
    return frame.box_around(low, high)


def _stable_rows(
    model: TransferFunction, integrators: int, margin: float | None
) -> tuple[Reals, Reals] | None:
    """Linear rows of abs(poles) <= 1 - margin, without an integrator among them."""
    na, p = model.na[0][0], len(model.parameters)
    if margin is None or not na:
        return None
    radius, order = 1.0 - margin, na - integrators
    # quotient A' of A = (1 - q^-1) A': running sums of the coefficients
    below = np.tril(np.ones((na, na))) if integrators else np.eye(na)
    start = 1.0 if integrators else 0.0
    quotient = np.zeros((order, p))
    quotient[:, :na] = below[:order]
    constant = np.full(order, start)
    matrix, right = [], []
    for i in range(order):
        size = comb(order, i + 1) * radius ** (i + 1) * (1.0 + 1e-12)
        matrix += [quotient[i], -quotient[i]]
        right += [size - constant[i], size + constant[i]]
    for sign in (1.0, -1.0):  # A'(+-radius) >= 0
        powers = (sign / radius) ** np.arange(1, order + 1)
        matrix.append(-powers @ quotient)
        right.append(1.0 + float(powers @ constant) + 1e-12 * float(np.abs(powers).sum()))
    return np.array(matrix), np.array(right)


def identified(
    data: IOData,
    model: TransferFunction,
    noise: Noise,
    known: ParameterSet | None,
    integrators: int,
    options: Options,
    margin: float | None = None,
    priors: tuple[Any, ...] = (),
) -> Identification:
    """Identify with the engine, starting from what sums of rows prove.

    Parameters
    ----------
    data, model, noise, integrators, options
        As usual.
    known : ParameterSet or None
        Its box is handed on as a prior that follows from the data.
    margin : float, optional
    priors : tuple of priors
    """
    known_priors = priors_of(model, known, integrators, margin)
    return identify(data, model, noise, [*priors, *known_priors], options)


def priors_of(
    model: TransferFunction,
    known: ParameterSet | None,
    integrators: int = 0,
    margin: float | None = None,
) -> list[Any]:
    """List what is proved or assumed of the parameters, as priors.

    Parameters
    ----------
    model, known, integrators, margin
        As for :func:`identified`. The box of ``known`` is widened a little, so that one that is
        computed again elsewhere lies within it.
    """
    found: list[Any] = []
    if known is not None and not known.empty:
        low, high = known.box
        room = 1e-9 * (high - low)
        low, high = low - room, high + room
        pairs = zip(known.names, low.tolist(), high.tolist(), strict=True)
        found.append(Box({name: (a, b) for name, a, b in pairs}))
    if integrators:
        x = parameters(model)
        total = sum((x[f"a{i}"] for i in range(2, model.na[0][0] + 1)), x["a1"])
        found.append(Given(total + 1 == 0))
    elif margin is not None and model.na[0][0]:
        found.append(Stable(margin=margin))
    return found


def tightened(known: ParameterSet, result: Identification, until: float = inf) -> ParameterSet:
    """Tighten a parameter set to the outer intervals of an identification.

    Parameters
    ----------
    known : ParameterSet
    result : Identification
        Of the same record, structure and noise.
    until : float
        Reading of ``time.monotonic`` that ends it by ``LimitReached``.
    """
    ends = np.array([result.intervals[name].outer for name in known.names])
    eye, finite = np.eye(len(known.names)), np.isfinite(ends)
    matrix = np.concatenate([eye[finite[:, 1]], -eye[finite[:, 0]]])
    right = np.concatenate([ends[finite[:, 1], 1], -ends[finite[:, 0], 0]])
    return within_doubles(lambda: known.within(frozen(matrix), frozen(right), until)) or known
