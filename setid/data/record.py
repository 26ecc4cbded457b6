"""Measured records: inputs, outputs and the sampling time, validated once and never modified."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.data.channels import labels, names_of, text_of, units_of
from setid.data.checks import (
    channels_of,
    entries_of,
    natural,
    number,
    range_of,
    starts_of,
    texts_of,
    word,
)
from setid.data.frames import check_indices, frame_column, series_names
from setid.data.readers import listed, read_mat_columns, stacked, vector
from setid.data.tables import Column, read_table
from setid.data.times import sampling_time
from setid.errors import DataError, warn
from setid.html import listing, section, table
from sparsepop_py.algebra.read_only import ReadOnly

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["IOData"]


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class IOData(ReadOnly):
    """One or several records of the same system, sampled at the same rate.

    Parameters
    ----------
    u : array_like (N,) or (N, nu)
        Measured inputs; NaN and masked elements of ``numpy.ma`` are missing samples.
    y : array_like (N,) or (N, ny)
        Measured outputs, likewise.
    Ts : float
        Sampling time in seconds, or in whatever unit the user counts time.
    starts : sequence of int, optional
        Row numbers (from 0) at which a record begins; the first is 0. Usually made by
        :meth:`concat`. No equation reaches across the beginning of a record.
    assumptions : sequence of str
        What was done to the numbers before they came here; results repeat it.
    u_range, y_range : (low, high) or array_like (channels, 2), optional
        A range that every noise-free sample is known to lie in. Missing samples become
        bounded unknowns with it; without it, equations that need them are left out.
    input_names, output_names : str or sequence of str, optional
        Names of the channels on tables and axes; when left out those of a DataFrame or Series,
        else u1, u2, ... and y1, y2, .... Equations and coefficients keep to these numbers.
    input_units, output_units : str or sequence of str, optional
        Their units; empty when left out.
    time_unit : str
        Unit of ``Ts``; empty when left out.

    Raises
    ------
    DataError
        If lengths differ, a channel has no sample, a value is infinite or ``Ts`` is not
        positive.

    Warns
    -----
    SetidWarning
        If an input never changes but is not zero: it excites nothing but the static gain. If
        there are fewer samples than channels, as of row vectors.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], Ts=0.1)
    >>> data
    <IOData: 4 samples, 1 input, 1 output, Ts = 0.1>
    >>> data.u.shape, data.y.shape
    ((4, 1), (4, 1))
    """

    u: NDArray[np.float64]
    y: NDArray[np.float64]
    Ts: float
    starts: NDArray[np.int64]
    assumptions: tuple[str, ...]
    u_range: NDArray[np.float64] | None
    y_range: NDArray[np.float64] | None
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    time_unit: str

    def __init__(
        self,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float = 1.0,
        *,
        starts: Sequence[int] | NDArray[np.int64] | None = None,
        assumptions: Iterable[str] = (),
        u_range: ArrayLike | None = None,
        y_range: ArrayLike | None = None,
        input_names: Sequence[str] | str | None = None,
        output_names: Sequence[str] | str | None = None,
        input_units: Sequence[str] | str | None = None,
        output_units: Sequence[str] | str | None = None,
        time_unit: str = "",
    ) -> None:
        input_names = series_names(u) if input_names is None else input_names
        output_names = series_names(y) if output_names is None else output_names
        inputs, outputs = channels_of(u, "u"), channels_of(y, "y")
        if inputs.shape[0] != outputs.shape[0]:
            raise DataError(
                f"u, y: found {inputs.shape[0]} and {outputs.shape[0]} samples, expected equal "
                "numbers (samples are rows, channels are columns)"
            )
        check_indices(u, y)
        step = number(Ts, "Ts", DataError)
        if not 0 < step < np.inf:
            raise DataError(f"Ts: found {Ts!r}, expected a positive number")
        fields = {
            "u": inputs,
            "y": outputs,
            "Ts": step,
            "starts": starts_of(starts, inputs.shape[0]),
            "assumptions": tuple(texts_of(assumptions, "assumptions", DataError)),
            "u_range": range_of(u_range, "u_range", inputs.shape[1]),
            "y_range": range_of(y_range, "y_range", outputs.shape[1]),
            "input_names": names_of(input_names, inputs.shape[1], "input_names", "u"),
            "output_names": names_of(output_names, outputs.shape[1], "output_names", "y"),
            "input_units": units_of(input_units, inputs.shape[1], "input_units"),
            "output_units": units_of(output_units, outputs.shape[1], "output_units"),
            "time_unit": text_of(time_unit, "time_unit"),
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)
        if inputs.shape[0] < max(inputs.shape[1], outputs.shape[1]):
            warn(
                f"u, y: found {inputs.shape[0]} samples of {inputs.shape[1]} inputs and "
                f"{outputs.shape[1]} outputs; samples are rows: transpose row vectors"
            )
        for channel in _constant_channels(inputs):
            warn(f"u: input {channel + 1} is constant; it excites only the static gain")

    # ---- shape --------------------------------------------------------------------------

    @property
    def samples(self) -> int:
        """Number of samples N, over all records."""
        return self.y.shape[0]

    @property
    def inputs(self) -> int:
        """Number of input channels nu."""
        return self.u.shape[1]

    @property
    def outputs(self) -> int:
        """Number of output channels ny."""
        return self.y.shape[1]

    @property
    def input_labels(self) -> tuple[str, ...]:
        """Names of the inputs with their units, for axes."""
        return labels(self.input_names, self.input_units)

    @property
    def output_labels(self) -> tuple[str, ...]:
        """Names of the outputs with their units, for axes."""
        return labels(self.output_names, self.output_units)

    @property
    def records(self) -> int:
        """Number of records."""
        return self.starts.size

    @property
    def first(self) -> NDArray[np.int64]:
        """Row at which the record of each sample begins, shape (N,)."""
        return self.starts[self.record]

    @property
    def record(self) -> NDArray[np.int64]:
        """Record of each sample, from 0, shape (N,)."""
        return np.searchsorted(self.starts, np.arange(self.samples), side="right") - 1

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample since the beginning of its record, shape (N,), in units of Ts."""
        return np.asarray((np.arange(self.samples) - self.first) * self.Ts, np.float64)

    # ---- from files ---------------------------------------------------------------------

    @classmethod
    def from_csv(
        cls,
        path: str | os.PathLike[str],
        inputs: Column | Sequence[Column],
        outputs: Column | Sequence[Column],
        Ts: float | None = None,
        *,
        decimal: str = ".",
        header: int | None = None,
        time: Column | None = None,
        time_unit: str = "",
    ) -> IOData:
        r"""Read a record from a text table.

        Parameters
        ----------
        path : path-like
            Separated by semicolons, tabs, commas or blanks; the first line may hold names.
            Comments (``#``, ``%``) and blank lines may stand above the table, never inside it:
            each line inside is a sample. What was skipped stands in ``assumptions``.
        inputs, outputs : str, int, or sequence of these
            Columns by name or by number from 0. Empty fields and the error values of
            spreadsheets (``#N/A``) are missing samples. Names stay those of the channels.
        Ts : float, optional
            Sampling time; that of the column ``time`` when left out, 1 without one.
        decimal : {".", ","}
            The decimal mark; with a comma, commas separate nothing.
        header : int, optional
            Lines before the first sample, of which the first holds the names and the second
            the units. By default one if the first line holds no number.
        time : str or int, optional
            A column of times. They must agree with ``Ts``, without gaps or drift; their jitter
            stands in ``assumptions``. Dates of ISO 8601 count in seconds.
        time_unit : str
            Unit of the times.

        Raises
        ------
        DataError
            Naming file, line, column and what was found.

        Examples
        --------
        >>> import pathlib, tempfile, setid
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "record.csv")
        ...     _ = path.write_text("time,valve,level\n0,1.0,0.0\n1,0.5,\n2,0.2,0.7\n")
        ...     data = setid.IOData.from_csv(path, inputs="valve", outputs="level", Ts=1.0)
        >>> data.y.ravel()
        array([0. , nan, 0.7])
        """
        left, right = listed(inputs), listed(outputs)
        table = read_table(path, [*left, *right], decimal, header, time)
        count, end = len(left), len(left) + len(right)
        u, y = stacked(table.columns[:count]), stacked(table.columns[count:end])
        notes = table.skipped
        if time is not None:
            Ts, seen = sampling_time(table.columns[-1], Ts, f"{path}, column {time!r}")
            notes += seen
        names, units = table.names, table.units
        return cls(
            u,
            y,
            1.0 if Ts is None else Ts,
            assumptions=notes,
            input_names=None if names is None else names[:count],
            output_names=None if names is None else names[count:end],
            input_units=None if units is None else units[:count],
            output_units=None if units is None else units[count:end],
            time_unit=time_unit or (units[-1] if units is not None and time is not None else ""),
        )

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        inputs: Column | Sequence[Column],
        outputs: Column | Sequence[Column],
        Ts: float | None = None,
        *,
        time: Column | None = None,
        time_unit: str = "",
    ) -> IOData:
        """Read a record from a DataFrame of pandas, or another with columns by name.

        Parameters
        ----------
        frame : DataFrame
            Rows are samples in their order.
        inputs, outputs : str or sequence of str
            Names of columns, which stay those of the channels. Missing values are missing
            samples. Where the frame has two lines of names (``pandas.read_csv(header=[0, 1])``),
            the second holds the units.
        Ts : float, optional
            Sampling time; that of the column ``time`` when left out, 1 without one.
        time : str, optional
            A column of times, or the name of the index (``"index"`` where it has none). Dates and
            spans of time count in seconds.
            As of :meth:`from_csv`; without it the index is not looked at.
        time_unit : str
            Unit of the times.

        Raises
        ------
        DataError
            If a column is missing, is given twice or holds no numbers, or times do not fit.
        """
        left, right = listed(inputs), listed(outputs)
        clock = [] if time is None else [time]
        given = [*left, *right, *clock]
        if twice := [name for name in given if given.count(name) > 1]:
            raise DataError(
                f"frame: found column {twice[0]!r} for two signals, expected one for each"
            )
        read = [frame_column(frame, name) for name in [*left, *right]]
        arrays, units = [values for values, _ in read], [unit for _, unit in read]
        notes: tuple[str, ...] = ()
        if time is not None:
            times, unit = frame_column(frame, time, dates=True)
            Ts, notes = sampling_time(times, Ts, f"column {time!r}")
            time_unit = time_unit or unit
        return cls(
            stacked(arrays[: len(left)]),
            stacked(arrays[len(left) :]),
            1.0 if Ts is None else Ts,
            assumptions=notes,
            input_names=[str(name) for name in left],
            output_names=[str(name) for name in right],
            input_units=units[: len(left)],
            output_units=units[len(left) :],
            time_unit=time_unit,
        )

    @classmethod
    def from_mat(
        cls,
        path: str | os.PathLike[str],
        u: str | Sequence[str] = "u",
        y: str | Sequence[str] = "y",
        Ts: float | None = None,
        *,
        time: str | None = None,
        time_unit: str = "",
    ) -> IOData:
        """Read a record from a MATLAB file (version 7 or older).

        Parameters
        ----------
        path : path-like
        u, y : str or sequence of str
            Names of the variables, ``"u"`` and ``"y"`` when left out; several become channels side
            by side. Each may be a row or a column of N numbers. Then its name stays that of the
            channel; channels of matrices are u1, ... and y1, ...
        Ts : float, optional
            Sampling time; that of the variable ``time`` when left out, 1 without one.
        time : str, optional
            A variable of N times, checked as those of :meth:`from_csv`.
        time_unit : str
            Unit of the times.

        Returns
        -------
        IOData

        Raises
        ------
        DataError
            If the file or a variable cannot be read, or times do not fit.

        Examples
        --------
        >>> import pathlib, tempfile, setid
        >>> from scipy.io import savemat
        >>> path = pathlib.Path(tempfile.mkdtemp(), "record.mat")
        >>> savemat(path, {"u": [1.0, 2.0], "y": [3.0, 4.0]})
        >>> setid.IOData.from_mat(path, Ts=0.1).y.ravel().tolist()
        [3.0, 4.0]
        """
        left, right = listed(u), listed(y)
        clock = [] if time is None else [time]
        arrays = read_mat_columns(path, [*left, *right, *clock])
        inputs, outputs = arrays[: len(left)], arrays[len(left) : len(left) + len(right)]
        notes: tuple[str, ...] = ()
        if time is not None:
            stacked([arrays[-1], *inputs])  # which refuses other numbers of samples
            Ts, notes = sampling_time(vector(arrays[-1], path, time), Ts, f"{path}, {time}")
        return cls(
            stacked(inputs),
            stacked(outputs),
            1.0 if Ts is None else Ts,
            assumptions=notes,
            time_unit=time_unit,
            input_names=left if all(one.shape[1] == 1 for one in inputs) else None,
            output_names=right if all(one.shape[1] == 1 for one in outputs) else None,
        )

    # ---- parts --------------------------------------------------------------------------

    def with_outputs(self, y: ArrayLike) -> IOData:
        """Replace the outputs of the record; nothing is said of its inputs again.

        Parameters
        ----------
        y : (N, ny) array_like
            NaN marks a missing sample.

        Raises
        ------
        DataError
            If the shape is another one.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([1.0, 2.0], [3.0, 4.0], Ts=0.1)
        >>> other = data.with_outputs([[5.0], [6.0]])
        >>> other.y.ravel().tolist(), other.Ts
        ([5.0, 6.0], 0.1)
        """
        outputs = channels_of(y, "y")
        if outputs.shape != self.y.shape:
            raise DataError(f"y: found shape {outputs.shape}, expected {self.y.shape}")
        found = copy(self)
        object.__setattr__(found, "y", outputs)
        return found

    @staticmethod
    def concat(records: Iterable[IOData]) -> IOData:
        """Join several records of one system; equations never cross a join.

        Parameters
        ----------
        records : iterable of IOData
            With equal channels, sampling times and ranges.

        Raises
        ------
        DataError
            If they differ.

        Examples
        --------
        >>> import setid
        >>> one, two = setid.IOData([1, 2, 3], [0, 1, 2]), setid.IOData([5, 4], [2, 2])
        >>> setid.IOData.concat([one, two]).starts
        array([0, 3])
        """
        parts = entries_of(records, "records", "a list of IOData", DataError)
        if not parts:
            raise DataError("records: found none, expected at least one")
        for place, part in enumerate(parts):
            if not isinstance(part, IOData):
                raise DataError(f"records[{place}]: found {type(part).__name__}, expected IOData")
            _check_alike(parts[0], part, place)
        offsets = np.cumsum([0, *(part.samples for part in parts[:-1])])
        texts = dict.fromkeys(text for part in parts for text in part.assumptions)
        return parts[0]._like(
            np.concatenate([part.u for part in parts]),
            np.concatenate([part.y for part in parts]),
            starts=np.concatenate([p.starts + o for p, o in zip(parts, offsets, strict=True)]),
            assumptions=tuple(texts),
        )

    def split(self, at: float) -> tuple[IOData, IOData]:
        """Split in estimation and validation parts: the rows before ``at`` and from it on.

        Parameters
        ----------
        at : int or float
            A row number in 1..N-1, which is the first row of the second part, or a fraction of the
            samples between 0 and 1, rounded to the nearest row.

        Returns
        -------
        tuple of IOData
            Two records. A record in which ``at`` lies goes on in the second part as a new one.

        Raises
        ------
        DataError
            If ``at`` is neither, or a part would have no reading of a channel.

        Examples
        --------
        >>> import setid
        >>> first, second = setid.IOData([1, 2, 3, 4], [5, 6, 7, 8]).split(0.75)
        >>> first.samples, second.y.ravel().tolist()
        (3, [8.0])
        """
        fraction = number(at, "at", DataError)
        whole = isinstance(at, (int, np.integer))
        row = int(at) if whole else round(min(max(fraction, 0.0), 1.0) * self.samples)
        if not 0 < row < self.samples:
            raise DataError(
                f"at: found {at!r}, expected a row in 1..{self.samples - 1} or a fraction in (0, 1)"
            )
        return self.part(0, row), self.part(row, self.samples)

    def part(self, first: int, end: int) -> IOData:
        """Take the rows from ``first`` to the one before ``end``.

        Parameters
        ----------
        first, end : int
            Row numbers from 0, where first < end <= N.

        Raises
        ------
        DataError
            If no such rows exist, or no reading is left of a channel.

        Examples
        --------
        >>> import setid
        >>> setid.IOData([1, 2, 3, 4], [5, 6, 7, 8]).part(1, 3).y.ravel()
        array([6., 7.])
        """
        begin = natural(first, "first", DataError)
        stop = natural(end, "end", DataError, least=begin + 1)
        if stop > self.samples:
            raise DataError(f"end: found {end!r}, expected at most {self.samples}, the samples")
        inside = self.starts[(self.starts > begin) & (self.starts < stop)] - begin
        starts = np.append(0, inside)
        return self._like(self.u[begin:stop], self.y[begin:stop], starts=starts)

    def decimate(self, m: int) -> IOData:
        """Take every m-th sample of each record, without filtering.

        A kept sample obeys its noise bound as before. The discrete model still holds only if the
        input does not change between kept samples; results list that among their assumptions.

        Parameters
        ----------
        m : int
            At least 1; the sampling time becomes m Ts.

        Returns
        -------
        IOData

        Raises
        ------
        DataError
            If m is no integer of at least 1.

        Examples
        --------
        >>> import setid
        >>> slow = setid.IOData([1, 1, 2, 2], [5, 6, 7, 8], Ts=0.1).decimate(2)
        >>> slow.y.ravel().tolist(), slow.Ts
        ([5.0, 7.0], 0.2)
        """
        step = natural(m, "m", DataError, least=1)
        keep = (np.arange(self.samples) - self.first) % step == 0
        note = f"decimated by {step}: the input is constant between the samples that were kept"
        return self._like(
            self.u[keep],
            self.y[keep],
            Ts=self.Ts * step,
            starts=np.searchsorted(np.flatnonzero(keep), self.starts),
            assumptions=(*self.assumptions, *((note,) if step > 1 else ())),
        )

    def detrend(self, kind: str = "constant") -> IOData:
        """Subtract mean or straight line from each channel of each record.

        The mean and the line are estimated from the data, and no noise bound covers their error.
        So results list among their assumptions that the trend is what least squares found. To keep
        an unknown constant among what is proved, make it a parameter of the model instead
        (``offset=True``). Ranges of signals are dropped.

        Parameters
        ----------
        kind : {"constant", "linear"}
            Mean, the default, or straight line.

        Returns
        -------
        IOData

        Raises
        ------
        DataError
            If the kind is another one.

        Examples
        --------
        >>> import setid
        >>> flat = setid.IOData([1, 2, 3], [5, 6, 10]).detrend()
        >>> flat.y.ravel().round(9).tolist(), len(flat.assumptions)
        ([-2.0, -1.0, 3.0], 1)
        """
        word(kind, "kind", ("constant", "linear"), DataError)
        degree = 0 if kind == "constant" else 1
        bounds = [*self.starts.tolist(), self.samples]
        parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
        note = f"detrended ({kind}): the trend of each channel is what least squares found"
        return self._like(
            np.concatenate([_without_trend(self.u[part], degree) for part in parts]),
            np.concatenate([_without_trend(self.y[part], degree) for part in parts]),
            starts=self.starts,
            assumptions=(*self.assumptions, note),
            u_range=None,
            y_range=None,
        )

    def plot(self, ax: Any = None) -> NDArray[Any] | Axes:
        """Draw outputs above inputs over time; returns the axes (needs matplotlib).

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One a channel.
        """
        from setid.plots.records import plot_record

        return plot_record(self, ax)

    def _repr_html_(self) -> str:
        named = zip(
            (*self.input_names, *self.output_names),
            (*self.input_units, *self.output_units),
            [*self.u.T, *self.y.T],
            strict=True,
        )
        rows = [
            (name, unit, int(np.isnan(values).sum()), *(f"{v:.6g}" for v in _spread(values)))
            for name, unit, values in named
        ]
        head = ["channel", "unit", "missing", "least", "mean", "largest"]
        return section(
            repr(self)[1:-1], table(head, rows), listing("assumptions", self.assumptions)
        )

    def _like(self, u: NDArray[Any], y: NDArray[Any], **changes: Any) -> IOData:
        kept: dict[str, Any] = {
            "Ts": self.Ts,
            "assumptions": self.assumptions,
            "u_range": self.u_range,
            "y_range": self.y_range,
            "input_names": self.input_names,
            "output_names": self.output_names,
            "input_units": self.input_units,
            "output_units": self.output_units,
            "time_unit": self.time_unit,
        }
        return IOData(u, y, **(kept | changes))

    def __repr__(self) -> str:
        def count(number: int, noun: str) -> str:
            return f"{number} {noun}{'' if number == 1 else 's'}"

        parts = [count(self.samples, "sample"), count(self.inputs, "input")]
        step = f"Ts = {self.Ts:g}{f' {self.time_unit}' if self.time_unit else ''}"
        parts += [count(self.outputs, "output"), step]
        if self.records > 1:
            parts.append(count(self.records, "record"))
        missing = int(np.isnan(self.u).sum() + np.isnan(self.y).sum())
        if missing:
            parts.append(f"{missing} missing")
        return f"<IOData: {', '.join(parts)}>"


def _constant_channels(inputs: NDArray[np.float64]) -> list[int]:
    """Channels with one value throughout; zero inputs are zero-input records, not mistakes."""
    if inputs.shape[0] < 2:
        return []
    low, high = np.nanmin(inputs, axis=0), np.nanmax(inputs, axis=0)
    return np.flatnonzero((low == high) & (low != 0.0)).tolist()


def _spread(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(np.nanmin(values)), float(np.nanmean(values)), float(np.nanmax(values))


def _check_alike(one: IOData, other: IOData, place: int) -> None:
    named = ("input_names", "output_names", "input_units", "output_units", "time_unit")
    for field in ("inputs", "outputs", "Ts", *named):
        if getattr(one, field) != getattr(other, field):
            raise DataError(
                f"records[{place}].{field}: found {getattr(other, field)}, "
                f"expected {getattr(one, field)} as in the first record"
            )
    for field in ("u_range", "y_range"):
        a, b = getattr(one, field), getattr(other, field)
        if (a is None) != (b is None) or (a is not None and not np.array_equal(a, b)):
            raise DataError(f"records[{place}].{field}: expected that of the first record")


def _without_trend(values: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    result = values.copy()
    time = np.linspace(-1.0, 1.0, len(values))
    for column in result.T:
        known = ~np.isnan(column)
        if np.any(known):
            most = min(degree, int(known.sum()) - 1)  # one reading is its own mean
            trend = np.polynomial.polynomial.polyfit(time[known], column[known], most)
            column -= np.polynomial.polynomial.polyval(time, trend)
    return result
