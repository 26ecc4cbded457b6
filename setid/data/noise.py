"""Bounded noise: a bound for each sample, and polynomial sets over the record."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import (
    entries_of,
    frozen,
    number,
    real_array,
    switch,
    texts_of,
    word,
)
from setid.data.digits import all_digits
from setid.data.record import IOData
from setid.errors import DataError, NoiseError
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = [
    "EnergyBound",
    "EstimatedBound",
    "Noise",
    "NoiseBounds",
    "NoiseConstraint",
    "RateLimit",
    "bound_at_rest",
    "estimate_noise_bound",
]

Bound = float | NDArray[np.float64]


class NoiseVariables(Protocol):
    """Numbers of noise samples and their polynomials, as constraints on the noise use them."""

    @property
    def starts(self) -> NDArray[np.int64]:
        """Rows at which records begin, shape (records,)."""

    def group(self, name: str) -> NDArray[np.int64]:
        """List variable numbers of a group, -1 where a sample has no variable."""

    def polynomial(self, number: int) -> sp.Polynomial:
        """Write a variable by number, as a polynomial in all variables."""


NoiseConstraint = Callable[[Any], Iterable[sp.Constraint]]
GROUPS = {"output": "eta", "input": "xi", "equation": "e"}


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedBound(ReadOnly):
    """A noise bound that was read off data, which makes it an assumption.

    Parameters
    ----------
    value : (channels,) float
        The bound of each channel.
    centre : (channels,) float
        The level about which the noise was measured.
    assumption : str
        What a result that uses this bound says about it.

    Examples
    --------
    >>> import setid
    >>> bound = setid.estimate_noise_bound([0.1, -0.1, 0.05, 0.0])
    >>> print(bound)
    0.1
    """

    value: NDArray[np.float64]
    centre: NDArray[np.float64]
    assumption: str

    def __str__(self) -> str:
        return ", ".join(f"{v:g}" for v in self.value)

    def __float__(self) -> float:
        """The largest bound of all channels."""
        return float(np.max(self.value))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.value, dtype)


class NoiseBounds(NamedTuple):
    """Bounds of the noise of every sample of a record.

    Parameters
    ----------
    output : (N, ny) float
    input : (N, nu) float
    equation : (N, ny) float
    """

    output: NDArray[np.float64]
    input: NDArray[np.float64]
    equation: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Noise(ReadOnly):
    """Bounded noise: measured output = output + eta, measured input = input + xi.

    Parameters
    ----------
    output : float, array_like or EstimatedBound
        Bound on abs(eta): one number, one a channel (ny,), one a sample (N,), or (N, ny).
        0 means that the outputs are exact and creates no variable.
    input : float, array_like or EstimatedBound
        Bound on abs(xi), likewise.
    equation : float, array_like or EstimatedBound
        Bound on the equation error e of each output's difference equation, likewise.
    relative : bool
        Output and input bounds are fractions of the reading, as data sheets give them:
        ``abs(eta[k]) <= output * abs(y[k])`` with the measured y. An error proportional
        to the true value, measured = true (1 + d) with abs(d) <= D < 1, is covered by
        the fraction D / (1 - D). Equation errors stay absolute.
    constraints : iterable of callables
        Further polynomial knowledge of the noise, such as :class:`EnergyBound` and
        :class:`RateLimit`. Each is called with the layout of the formulation, whose
        ``variable("eta[3]")`` is a polynomial, and returns ``sp`` constraints.

    Attributes
    ----------
    assumptions : tuple of str
        What bounds that were read off data take for granted; results repeat it.
    model_error : float
        Added to the bound of every output sample by :meth:`covering`; 0 before.

    Raises
    ------
    NoiseError
        If a bound is negative or not a number.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 4], [2, 4, 8])
    >>> noise = setid.Noise(output=0.1, input=[0.0, 0.01, 0.01])
    >>> output, input, equation = noise.bounds(data)
    >>> output.ravel(), input.ravel(), equation.ravel()
    (array([0.1, 0.1, 0.1]), array([0.  , 0.01, 0.01]), array([0., 0., 0.]))
    """

    output: Bound
    input: Bound
    equation: Bound
    relative: bool
    constraints: tuple[NoiseConstraint, ...]
    assumptions: tuple[str, ...]
    model_error: float

    def __init__(
        self,
        output: float | ArrayLike | EstimatedBound = 0.0,
        input: float | ArrayLike | EstimatedBound = 0.0,
        equation: float | ArrayLike | EstimatedBound = 0.0,
        relative: bool = False,
        constraints: Iterable[NoiseConstraint] = (),
    ) -> None:
        in_parts = switch(relative, "relative", NoiseError)
        given = {"output": output, "input": input, "equation": equation}
        sets = tuple(
            [constraints]
            if callable(constraints)
            else entries_of(constraints, "constraints", "a list of callables", NoiseError)
        )
        for place, item in enumerate(sets):
            if not callable(item):
                raise NoiseError(
                    f"constraints[{place}]: found {type(item).__name__}, expected a callable "
                    "such as EnergyBound('output', 3.0)"
                )
        fields = {
            **{key: _bound(value, key) for key, value in given.items()},
            "relative": in_parts,
            "constraints": sets,
            "assumptions": tuple(
                f"{key} noise: {value.assumption}"
                for key, value in given.items()
                if isinstance(value, EstimatedBound)
            ),
            "model_error": 0.0,
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    def covering(self, delta: float | EstimatedBound) -> Noise:
        """Widen the noise to outputs that differ from the model's by at most ``delta``.

        Parameters
        ----------
        delta : float or EstimatedBound
            Added to the bound of every output sample, in place of what was added before;
            a discretisation error of :class:`ContinuousTransferFunction` is one.

        Raises
        ------
        NoiseError
            If constraints may speak of the output noise, of which ``delta`` is no part.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([1, 2], [2, 4])
        >>> setid.Noise(output=0.25).covering(0.5).bounds(data)[0].ravel()
        array([0.75, 0.75])
        """
        found = copy(self)
        if isinstance(delta, EstimatedBound):
            texts = dict.fromkeys([*self.assumptions, delta.assumption])
            object.__setattr__(found, "assumptions", tuple(texts))
            delta = float(delta.value.max())
        if not 0.0 <= number(delta, "delta", NoiseError) < np.inf:
            raise NoiseError(f"delta: found {delta!r}, expected a number >= 0")
        own = (EnergyBound, RateLimit)
        known = (isinstance(one, own) and one.kind != "output" for one in self.constraints)
        if delta and not all(known):
            raise NoiseError(
                f"constraints: found constraints of the output noise beside delta = {delta:g}, "
                "expected none: unknowns of the outputs hold that error, too"
            )
        object.__setattr__(found, "model_error", float(delta))
        return found

    def assuming(self, texts: Iterable[str]) -> Noise:
        """Repeat what other bounds take for granted, where these bounds are made from them.

        Parameters
        ----------
        texts : iterable of str
            In front of the own ``assumptions``.

        Examples
        --------
        >>> import setid
        >>> setid.Noise(output=0.25).assuming(["output noise: half of what was seen"]).assumptions
        ('output noise: half of what was seen',)
        """
        found = copy(self)
        given = texts_of(texts, "texts", NoiseError)
        texts = tuple(dict.fromkeys([*given, *self.assumptions]))
        object.__setattr__(found, "assumptions", texts)
        return found

    @property
    def scaled(self) -> str:
        """Name what a factor on the noise multiplies.

        Examples
        --------
        >>> import setid
        >>> setid.Noise(output=0.25).covering(0.5).scaled
        'the noise bounds and delta = 0.5 together'
        """
        together = f" and delta = {all_digits(self.model_error)} together"
        return "the noise bounds" + (together if self.model_error else "")

    def bounds(self, data: IOData) -> NoiseBounds:
        """Compute bounds of output noise (N, ny), input noise (N, nu), equation error (N, ny).

        Parameters
        ----------
        data : IOData

        Returns
        -------
        NoiseBounds
            In the units of the signals; relative bounds are multiplied by the sizes of the
            readings. Missing samples have no noise: their bound is 0.

        Raises
        ------
        NoiseError
            If the shape of a bound does not fit the data, or a bound is beyond all doubles.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([1, 2], [3, 4])
        >>> [bound.ravel().tolist() for bound in setid.Noise(output=0.5).bounds(data)]
        [[0.5, 0.5], [0.0, 0.0], [0.0, 0.0]]
        """
        if not isinstance(data, IOData):
            raise DataError(f"data: found {type(data).__name__}, expected IOData")
        output = _spread(self.output, "output", data.samples, data.outputs)
        input = _spread(self.input, "input", data.samples, data.inputs)
        with np.errstate(over="ignore"):
            if self.relative:
                output, input = _parts_of(output, data.y), _parts_of(input, data.u)
            if self.model_error:
                output = np.nextafter(output + self.model_error, np.inf)
        for field, bound in (("output", output), ("input", input)):
            if np.any(np.isinf(bound)):
                raise NoiseError(f"{field}: found a bound beyond all doubles, expected less")
        output = np.where(np.isnan(data.y), 0.0, output)
        input = np.where(np.isnan(data.u), 0.0, input)
        equation = _spread(self.equation, "equation", data.samples, data.outputs)
        return NoiseBounds(output, input, equation)


def _parts_of(share: NDArray[np.float64], samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply shares with sizes of samples, rounded up so that no noise is lost."""
    bound = share * np.abs(samples)
    return np.where((share > 0) & (samples != 0), np.nextafter(bound, np.inf), bound)


@dataclass(frozen=True, slots=True)
class EnergyBound:
    """Euclidean norm of the noise over each record, all channels together.

    Parameters
    ----------
    kind : {"output", "input", "equation"}
        Which noise.
    radius : float
        In the unit of the signal, at least 0: the sum of squares of the samples of a record is at
        most its square.

    Raises
    ------
    NoiseError
        If kind or radius are none of these.

    Examples
    --------
    >>> import setid
    >>> noise = setid.Noise(output=1.0, constraints=[setid.EnergyBound("output", 3.0)])
    >>> noise.constraints[0].radius  # nine samples of size 1 are allowed, ten are not
    3.0
    """

    kind: str
    radius: float

    def __post_init__(self) -> None:
        _check_set(self.kind, self.radius, "radius")

    def describe(self) -> str:
        """Say what is assumed, as results repeat it."""
        return (
            f"the Euclidean norm of the {self.kind} noise over each record is at most "
            f"{self.radius!r}"
        )

    def __call__(self, layout: NoiseVariables) -> list[sp.Constraint]:
        """One quadratic inequality for each record."""
        rows = []
        for samples in _by_record(layout, self.kind):
            squares = [layout.polynomial(v) ** 2 for v in samples[samples >= 0].tolist()]
            if squares and (most := _square(self.radius)) < np.inf:
                rows.append(sp.total(squares) <= most)
        return rows


@dataclass(frozen=True, slots=True)
class RateLimit:
    """Largest change of the noise between neighbouring samples of a record.

    Parameters
    ----------
    kind : {"output", "input", "equation"}
        Which noise.
    limit : float
        In the unit of the signal, per sampling interval; at least 0.

    Raises
    ------
    NoiseError
        If kind or limit are none of these.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> noise = setid.Noise(output=0.5, constraints=[setid.RateLimit("output", 0.2)])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), noise)
    >>> len(known.problem.constraints)  # three equations, and both signs of three differences
    9
    """

    kind: str
    limit: float

    def __post_init__(self) -> None:
        _check_set(self.kind, self.limit, "limit")

    def describe(self) -> str:
        """Say what is assumed, as results repeat it."""
        return f"{self.kind} noise changes by at most {self.limit!r} from sample to sample"

    def __call__(self, layout: NoiseVariables) -> list[sp.Constraint]:
        """Two linear inequalities for each pair of neighbours that both have noise."""
        rows = []
        for samples in _by_record(layout, self.kind):
            for channel in samples.T.tolist():
                for before, after in zip(channel[:-1], channel[1:], strict=True):
                    if before >= 0 and after >= 0:
                        step = layout.polynomial(after) - layout.polynomial(before)
                        rows += [step <= self.limit, step >= -self.limit]
        return rows


def estimate_noise_bound(
    zero_input_record: IOData | ArrayLike, margin: float = 1.0, offset: bool = True
) -> EstimatedBound:
    """Estimate a sensor's noise bound from a record taken at rest, with zero input.

    Parameters
    ----------
    zero_input_record : IOData or array_like (N,) or (N, channels)
        Outputs of the system at rest.
    margin : float
        Factor >= 1 on what was seen: a finite record need not show the largest noise.
    offset : bool
        Measure about the middle of the range; False measures about zero.

    Returns
    -------
    EstimatedBound
        To be given to :class:`Noise`; results list it among their assumptions.

    Raises
    ------
    NoiseError
        If the input of the record is not zero throughout, or what is given is no record.

    Examples
    --------
    >>> import setid
    >>> bound = setid.estimate_noise_bound([0.1, -0.2, 0.3, -0.1])
    >>> print(bound)
    0.25
    >>> noise = setid.Noise(output=bound)
    >>> noise.assumptions[0]
    'output noise: bound 0.25 estimated from 4 samples at rest (margin 1)'
    """
    factor = number(margin, "margin", NoiseError)
    if not 1.0 <= factor < np.inf:
        raise NoiseError(f"margin: found {margin!r}, expected a factor >= 1")
    return bound_at_rest(zero_input_record, "zero_input_record", factor, offset)


def bound_at_rest(
    record: IOData | ArrayLike, field: str, margin: float = 1.0, offset: bool = True
) -> EstimatedBound:
    """Estimate a noise bound as :func:`estimate_noise_bound`, for messages that name ``field``.

    Parameters
    ----------
    record : IOData or array_like
    field : str
        What the caller's argument is called.
    margin : float
    offset : bool
    """
    if not isinstance(record, IOData):
        values = real_array(record, field, NoiseError)
        if values.ndim not in (1, 2) or not values.size:
            raise NoiseError(f"{field}: found shape {values.shape}, expected (N,) or (N, channels)")
        empty = np.flatnonzero(np.all(np.isnan(values.reshape(len(values), -1)), axis=0))
        if empty.size:
            raise NoiseError(f"{field}: found no number in channel {empty[0] + 1}, expected some")
        record = IOData(np.zeros(values.shape[:1]), values)
    if np.any(np.nan_to_num(record.u) != 0.0):
        raise NoiseError(f"{field}: found inputs that are not zero, expected rest")
    low, high = np.nanmin(record.y, axis=0), np.nanmax(record.y, axis=0)
    read = int(np.min(np.count_nonzero(~np.isnan(record.y), axis=0)))
    moved = switch(offset, "offset", NoiseError)
    centre = low / 2 + high / 2 if moved else np.zeros_like(low)  # a sum might overflow
    with np.errstate(over="ignore"):
        value = margin * np.maximum(high - centre, centre - low)
    if not np.all(np.isfinite(value)):
        raise NoiseError(f"margin: found {margin!r}, times what was seen no double, expected less")
    text = ", ".join(all_digits(v) for v in value)
    return EstimatedBound(
        frozen(value),
        frozen(centre),
        f"bound {text} estimated from {read} samples at rest (margin {all_digits(margin)})",
    )


def _bound(given: Any, field: str) -> Bound:
    value = given.value if isinstance(given, EstimatedBound) else given
    values = real_array(value, field, NoiseError)
    if isinstance(value, bool) or values.ndim > 2 or not np.all(values >= 0):
        raise NoiseError(
            f"{field}: found {value!r:.60}, expected bounds >= 0: a number, one a channel, "
            "one a sample, or (N, channels)"
        )
    return float(values) if values.ndim == 0 else frozen(values)


def _spread(bound: Bound, field: str, samples: int, channels: int) -> NDArray[np.float64]:
    """The bound as an array (N, channels)."""
    if isinstance(bound, numbers.Real):
        return np.full((samples, channels), float(bound))
    values = np.asarray(bound)
    if values.shape == (channels,):
        if samples == channels > 1:
            raise NoiseError(
                f"{field}: found shape {values.shape}, which may be one a channel or one a "
                "sample; give (N, channels)"
            )
        return np.tile(values, (samples, 1))
    if values.shape == (samples,):
        return np.tile(values[:, None], (1, channels))
    if values.shape == (samples, channels):
        return values.copy()
    raise NoiseError(
        f"{field}: found shape {values.shape}, expected (), ({channels},), ({samples},) or "
        f"({samples}, {channels})"
    )


def _square(size: float) -> float:
    """Square a number >= 0, rounded upwards so that no noise is lost."""
    found = float(size) * float(size)
    if found < np.inf and Fraction(found) < Fraction(size) ** 2:
        found = float(np.nextafter(found, np.inf))
    return found


def _check_set(kind: str, size: float, field: str) -> None:
    word(kind, "kind", GROUPS, NoiseError)
    if not 0 <= number(size, field, NoiseError) < np.inf:
        raise NoiseError(f"{field}: found {size!r}, expected a number >= 0")


def _by_record(layout: NoiseVariables, kind: str) -> list[NDArray[np.int64]]:
    """Variable numbers of one kind of noise, an array (samples, channels) for each record."""
    numbers_ = layout.group(GROUPS[kind])
    return np.split(numbers_, layout.starts[1:])
