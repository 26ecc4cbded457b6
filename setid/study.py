"""Studies whose tasks are identifications: records x structures x noise levels x seeds."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import sparsepop_py as sp
from setid.data.checks import entries_of
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import SetidError
from setid.formulation.formulation import formulate
from setid.formulation.regression import check_channels
from setid.identify import identify
from setid.models.continuous import ContinuousTransferFunction, without_delta
from setid.models.equations import Structure
from setid.options import Options
from setid.priors.base import Prior
from setid.result.certificate_files import certificate_files
from setid.result.identification import Identification
from setid.result.json_ import from_json, to_json
from sparsepop_py.study.content import dump, fingerprint, load
from sparsepop_py.study.problems import repeatable
from sparsepop_py.study.study import BaseStudy, Tags, Work

__all__ = ["Study"]

_RECORD = b"record"  # what is stored is no JSON

Priors = Iterable[Prior | sp.Constraint] | Prior | sp.Constraint


def _rows(result: Identification) -> list[dict[str, Any]]:
    rows = []
    for name, interval in result.intervals.items():
        inner = (None, None) if interval.inner is None else interval.inner
        rows.append(
            {
                "parameter": name,
                "status": str(interval.status),
                "outer_low": float(interval.outer[0]),
                "outer_high": float(interval.outer[1]),
                "inner_low": None if inner[0] is None else float(inner[0]),
                "inner_high": None if inner[1] is None else float(inner[1]),
            }
        )
    return rows


def _write(result: Identification, trusted: tuple[str, ...]) -> bytes:
    """Write JSON, or a record where a structure or prior of the user's has no text."""
    try:
        return zlib.compress(to_json(result).encode())
    except SetidError:
        lean = tuple(replace(each, relaxation=None, solution=None) for each in result.results)
        return _RECORD + dump(replace(result, results=lean), "result", trusted)


def _read(content: bytes, place: str, trusted: tuple[str, ...]) -> Identification:
    """Read a result and verify its claims; nothing in a file is believed."""
    if content.startswith(_RECORD):
        return _verified(load(content.removeprefix(_RECORD), place, trusted), place)
    try:
        return from_json(zlib.decompress(content).decode())
    except (zlib.error, UnicodeDecodeError) as error:
        raise sp.FormatError(f"{place}: found damaged content: {error}") from error
    except SetidError as error:
        raise SetidError(f"{place}: {error}") from error


def _verified(found: Any, place: str) -> Identification:
    if not isinstance(found, Identification):
        raise SetidError(f"{place}: found {type(found).__name__}, expected an Identification")
    checked = found.verify()
    if not checked:
        raise SetidError(f"{place}: found a claim that does not hold: {checked.reason}")
    return found


def _belongs(result: Identification, given: tuple[Any, ...]) -> bool:
    """Compare with the task as it is stated: record, structure, and all rows of the problem.

    The rows hold noise and priors. A ``delta`` that was estimated is that of the result.
    """
    about, (data, model, noise, priors) = result.formulation, given[:4]
    if isinstance(model, ContinuousTransferFunction) and model.delta == "estimate":
        model, noise = without_delta(model), noise.covering(about.noise.model_error)
    stated = formulate(data, model, noise, priors)
    same = fingerprint((about.data, about.model)) == fingerprint((stated.data, stated.model))
    return same and about.problem.fingerprint == stated.problem.fingerprint


def _certificate(result: Identification) -> str:
    return json.dumps(certificate_files(result), allow_nan=False)


class Study(BaseStudy):
    """Many identifications in one file, done once each, whatever happens on the way.

    The table has one row a parameter.

    Parameters
    ----------
    path : str or PathLike
        An SQLite file, made where there is none.
    trusted : iterable of str
        Modules of your own whose structures or priors the tasks contain.

    Raises
    ------
    FormatError
        If the file is something else, or a study of another kind.
    OutputError
        If it cannot be made.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> study = setid.Study("levels.study")
    >>> for bound in (0.25, 0.5):
    ...     noise = setid.Noise(equation=bound)
    ...     study.add(f"bound {bound}", data, setid.TransferFunction(1, 1), noise)
    >>> print(study.run())
    2 of 2 tasks
    >>> [(row["parameter"], row["status"]) for row in study.table()][2:]
    [('a1', 'certified'), ('b0', 'certified')]
    >>> study.result("bound 0.5").intervals["b0"]
    b0 in [1.91666, 2.10931], attained [1.91667, 2.1093], certified
    """

    work = Work(
        "identify",
        identify,
        _rows,
        _write,
        _read,
        _certificate,
        ("parameter", "status", "outer_low", "outer_high", "inner_low", "inner_high"),
        _belongs,
    )

    def add(
        self,
        name: str,
        data: IOData,
        model: Structure,
        noise: Noise,
        priors: Priors = (),
        options: Options | None = None,
        *,
        tags: Tags | None = None,
    ) -> None:
        """Add an identification; the same one again changes nothing.

        Parameters
        ----------
        name : str
            Of its rows in the table.
        data : IOData
        model : Structure
        noise : Noise
        priors : iterable of priors and ``sp`` constraints
        options : Options, optional
            As of :func:`setid.identify`. Without a limit no decision of the engine rests on a
            clock, so that results repeat, but for stages with seconds of their own.
        tags : mapping of str to str or number, optional
            Further columns of its rows, such as the noise level.

        Raises
        ------
        SetidError
            If an argument is malformed.
        ProblemError
            If the name belongs to another task, or something cannot be stored.
        OutputError
            If another run writes the file.
        """
        self.add_all([(name, data, model, noise, priors, options, tags)])

    def add_all(self, tasks: Iterable[tuple[Any, ...]]) -> None:
        """Add many identifications, all or none of them; faster than one by one.

        Parameters
        ----------
        tasks : iterable of (name, data, model, noise, priors, options, tags)
            As of :meth:`add`.

        Raises
        ------
        SetidError
            If an argument is malformed.
        ProblemError
            If a name belongs to another task, or something cannot be stored.
        OutputError
            If another run writes the file.
        """
        expected = "name, data, model, noise, priors, options and tags"
        entries = []
        for number, task in enumerate(entries_of(tasks, "tasks", "a list of tasks", SetidError)):
            parts = entries_of(task, f"tasks[{number}]", expected, SetidError)
            if not 4 <= len(parts) <= 7:
                raise SetidError(
                    f"tasks[{number}]: found {len(parts)} entries, expected {expected}"
                )
            entries.append(self._task(*parts))
        self._add(entries)

    def _task(
        self,
        name: str,
        data: Any,
        model: Any,
        noise: Any,
        priors: Any = (),
        options: Any = None,
        tags: Tags | None = None,
    ) -> Any:
        for value, kind, field in ((data, IOData, "data"), (noise, Noise, "noise")):
            if not isinstance(value, kind):
                raise SetidError(f"{field}: found {type(value).__name__}, expected {kind.__name__}")
        check_channels(data, model)
        if options is not None and not isinstance(options, Options):
            raise SetidError(f"options: found {type(options).__name__}, expected setid.Options")
        several = isinstance(priors, (list, tuple)) or not hasattr(priors, "__dataclass_fields__")
        listed = entries_of(priors, "priors", "priors", SetidError) if several else [priors]
        given = tuple(listed)
        settings = _repeatable(options or Options())
        return self._entry(name, (data, model, noise, given, settings), tags)


def _repeatable(options: Options) -> Options:
    """Count work in place of time unless a time limit is given; switch progress off."""
    if options.time_limit is None:
        engine = repeatable(options.engine or sp.Options(effort="auto"))
        options = replace(options, engine=engine)
    return replace(options, progress=False)
