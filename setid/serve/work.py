"""One identification for the page, in a process of its own: from a form to texts and pictures."""

from __future__ import annotations

import csv
import io
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

import sparsepop_py as sp
from setid.bands.outputs import Mode
from setid.consistency import consistency
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, SetidError
from setid.identify import identify
from setid.minimum_noise.consistency_result import Consistency
from setid.models.continuous import ContinuousTransferFunction
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.models.registry import family_of
from setid.options import Options
from setid.priors import Stable
from setid.result.identification import Identification
from setid.result.json_ import certificate_text
from sparsepop_py.files import write_text

__all__ = ["Form", "check_columns", "check_lines", "check_samples", "read_form", "work"]

Ends = tuple[float, float]
_CLOSED = 1e-3  # of the attained width, the tolerance of options
_OTHER_LINES = 1000  # names, comments, blank lines
_FOR_INTERVALS, _FOR_A_BAND = 0.75, 20.0  # of the time that is left; seconds
MOST_COLUMNS = 1000
MOST_SAMPLES, MOST_ORDER, MOST_PARAMETERS, MOST_SECONDS = 20_000, 20, 300, 3600.0
_ERRORS = (SetidError, sp.SparsePOPError, ValueError, ArithmeticError)


@dataclass(frozen=True, slots=True)
class Form:
    """All that the page asks for, checked.

    Parameters
    ----------
    record : IOData
        For the identification.
    validation : IOData or None
        The rest of the file.
    model : Structure
    noise : Noise
    stable : bool
    seconds : float
        Time limit of the whole work; most of it is for the intervals.
    file : str
        Name of the table, as the page knows it.
    """

    record: IOData
    validation: IOData | None
    model: Structure
    noise: Noise
    stable: bool
    seconds: float
    file: str

    def asked(self) -> list[tuple[str, str]]:
        """List what the answers are about, with all digits, a line each."""
        data, whole = self.record, self.record.samples
        if self.validation is not None:
            whole += self.validation.samples
        channels = f"{', '.join(data.input_names)} -> {', '.join(data.output_names)}"
        bounds = {kind: getattr(self.noise, kind) for kind in ("equation", "output", "input")}
        rows = [
            ("file", self.file),
            ("samples", f"{data.samples} of {whole}, every {data.Ts!r}"),
            ("inputs and outputs", channels),
            ("structure", f"{self.model!r:.2000}"),
            ("noise bounds", ", ".join(f"{kind} {value!r}" for kind, value in bounds.items())),
            ("stable", "assumed" if self.stable else "not assumed"),
            ("time limit", f"{self.seconds:g} s"),
        ]
        return [(name, text if text.isprintable() else repr(text)) for name, text in rows]


def check_lines(content: bytes) -> None:
    """Check that a file is not too long for the page, before it is read.

    Parameters
    ----------
    content : bytes
        A table, perhaps with comments before it and blank lines after it.

    Raises
    ------
    DataError
    """
    lines = content.count(b"\n") + content.count(b"\r") - content.count(b"\r\n")
    if lines > MOST_SAMPLES + _OTHER_LINES:
        raise DataError(f"record: found {lines} lines, expected at most {MOST_SAMPLES} samples")


def check_columns(columns: Sequence[object]) -> None:
    """Check that a table has at least two columns, and not too many for the page.

    Parameters
    ----------
    columns : sequence
        Their names or numbers.

    Raises
    ------
    DataError
    """
    count = len(columns)
    if not 2 <= count <= MOST_COLUMNS:
        found = "one column" if count == 1 else f"{count} columns"
        raise DataError(
            f"record: found {found}, expected an input and an output, and at most {MOST_COLUMNS}"
        )


def check_samples(data: IOData) -> None:
    """Check that a record is not too long for the page.

    Raises
    ------
    DataError
    """
    if data.samples > MOST_SAMPLES:
        raise DataError(f"record: found {data.samples} samples, expected at most {MOST_SAMPLES}")


def read_form(path: Path, given: Mapping[str, Any], decimal: str = ".") -> Form:
    """Check the fields of a form for the record of a file.

    Parameters
    ----------
    path : Path
        Of the table that was sent.
    given : mapping
        ``inputs``, ``outputs`` (names or numbers of columns), ``Ts``, ``samples`` (0: all),
        ``structure``, ``na``, ``nb``, ``nk``, ``offset``, ``equation``, ``output``, ``input``,
        ``stable``, ``seconds`` and ``file``, the name of the table.
    decimal : {".", ","}
        The decimal mark of the table.

    Raises
    ------
    SetidError
        Naming the field, what was found and what was expected.
    """
    inputs, outputs = (_columns(given, field) for field in ("inputs", "outputs"))
    Ts = _positive(given, "Ts", 1.0)
    data = IOData.from_csv(path, inputs, outputs, Ts, decimal=decimal)
    check_samples(data)
    count = _whole(given, "samples", 0, data.samples)
    record, validation = data.split(count) if 0 < count < data.samples else (data, None)
    output, input, equation = (_bound(given, kind) for kind in ("output", "input", "equation"))
    if not output + input + equation:
        raise NoiseError("noise: found no bound above 0, expected one of at least one kind")
    return Form(
        record,
        validation,
        _model(given, data),
        Noise(output, input, equation),
        _stable(given),
        min(_positive(given, "seconds", 60.0), MOST_SECONDS),
        str(given.get("file", "a table"))[:200],
    )


def _columns(given: Mapping[str, Any], field: str) -> list[str | int]:
    found = given.get(field)
    if not isinstance(found, list) or not found or len(found) > 8:
        raise DataError(f"{field}: found {found!r:.80}, expected one to eight columns")
    if not all(isinstance(item, (str, int)) for item in found):
        raise DataError(f"{field}: found {found!r:.80}, expected names or numbers")
    return found


def _finite(given: Mapping[str, Any], field: str, default: float, expected: str) -> float:
    found = given.get(field, default)
    right = isinstance(found, (int, float)) and not isinstance(found, bool)
    if not right or not -sys.float_info.max <= found <= sys.float_info.max:
        raise SetidError(f"{field}: found {found!r:.80}, expected {expected}")
    return float(found)


def _positive(given: Mapping[str, Any], field: str, default: float) -> float:
    expected = "a finite number above 0"
    found = _finite(given, field, default, expected)
    if found <= 0:
        raise SetidError(f"{field}: found {found:g}, expected {expected}")
    return found


def _bound(given: Mapping[str, Any], field: str) -> float:
    """Read a noise bound, 0 without one."""
    expected = "a finite noise bound >= 0"
    found = _finite(given, field, 0.0, expected)
    if found < 0:
        raise NoiseError(f"{field}: found {found:g}, expected {expected}")
    return found


def _flag(given: Mapping[str, Any], field: str) -> bool:
    found = given.get(field, False)
    if not isinstance(found, bool):
        raise SetidError(f"{field}: found {found!r:.80}, expected true or false")
    return found


def _stable(given: Mapping[str, Any]) -> bool:
    stable = _flag(given, "stable")
    if stable and given.get("structure") == "PolynomialNARX":
        raise ModelError("stable: found true, expected false: polynomial regressions have no poles")
    return stable


def _whole(given: Mapping[str, Any], field: str, default: int, most: int) -> int:
    found = given.get(field, default)
    if type(found) is not int or not 0 <= found <= most:
        raise SetidError(f"{field}: found {found!r:.80}, expected an integer from 0 to {most}")
    return found


def _model(given: Mapping[str, Any], data: IOData) -> Structure:
    kind = given.get("structure", "TransferFunction")
    na, nb, nk = (_whole(given, field, 0, MOST_ORDER) for field in ("na", "nb", "nk"))
    offset = _flag(given, "offset")
    if kind == "TransferFunction":
        return TransferFunction(na, nb, nk, data.inputs, data.outputs, offset=offset)
    if kind not in ("ContinuousTransferFunction", "PolynomialNARX"):
        raise ModelError(f"structure: found {kind!r:.80}, expected a structure of the list")
    for field, found, least in (("nk", nk, 0), ("offset", offset, False)):
        if found != least:
            raise ModelError(f"{field}: found {found}, expected {least}: {kind} has none here")
    if nb == 0:
        raise ModelError(f"nb: found 0, expected at least 1 for {kind}")
    if kind == "ContinuousTransferFunction":
        return ContinuousTransferFunction(na, nb - 1)
    family = family_of(kind)
    assert family is not None
    signals = len(family(na, 1, data.inputs, data.outputs).parameters) // data.outputs - 1
    count = comb(signals + nb, nb) * data.outputs
    if count > MOST_PARAMETERS:
        raise ModelError(
            f"na, nb: found order {na} and degree {nb}, which make {count} parameters, expected at "
            f"most {MOST_PARAMETERS}"
        )
    return family(na, nb, data.inputs, data.outputs)


# ---- the work -----------------------------------------------------------------------------------


def work(form: Form, folder: str) -> dict[str, Any]:
    """Identify for the page; parts are written as they are done.

    Parameters
    ----------
    form : Form
    folder : str
        Where ``progress.json`` and the files to download go.

    Returns
    -------
    dict
        ``status``, ``sections`` (titles with HTML or SVG), ``files`` (names for download).
    """
    report = _Report(Path(folder), len(form.model.parameters))
    report.add("What was asked", _table(form.asked()))
    report.stage("consistency")
    end = time.monotonic() + form.seconds
    limit = Options(time_limit=max(form.seconds / 4, 1.0), progress=False)
    priors = [Stable()] if form.stable else []
    scale = consistency(form.record, form.model, form.noise, priors, limit)
    report.add("Do the noise bounds explain the record?", _html(scale))
    report.stage("intervals")
    options = Options(time_limit=_share(end, _FOR_INTERVALS), progress=False)
    result = identify(
        form.record, form.model, form.noise, priors, options, on_progress=report.interval
    )
    report.add("Intervals", _html(result))
    report.stage("files")
    asked = "".join(f"{name}: {value}\n" for name, value in form.asked())
    report.file("report.txt", lambda: f"{asked}\n{result.summary()}")
    report.file("result.json", lambda: result.to_json())
    report.file("certificate.json", lambda: certificate_text(result))
    report.file("record.csv", lambda: _samples(form.record))
    if not result.empty:
        _pictures(report, form, result, end)
    return {"status": str(result.status), "sections": report.sections, "files": report.files}


def _html(found: Consistency | Identification) -> str:
    return found._repr_html_()


def _table(rows: list[tuple[str, str]]) -> str:
    cells = (f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{''.join(cells)}</table>"


def _samples(data: IOData) -> str:
    """Write the samples that were used as a table, with all digits.

    Without names where these do not tell the columns apart, or hold a separator: columns are
    then in the order of the channels.
    """
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    names = [*data.input_names, *data.output_names]
    if len(set(names)) == len(names) and not any(set(name) & set(',;\t"#%') for name in names):
        table.writerow(names)
    for row in np.hstack([data.u, data.y]).tolist():
        table.writerow(["" if np.isnan(value) else repr(value) for value in row])
    return out.getvalue()


def _share(end: float, part: float, most: float = MOST_SECONDS) -> float:
    """Return a part of the seconds that are left, at least a second and at most so many."""
    return min(max(part * (end - time.monotonic()), 1.0), most)


def _pictures(report: _Report, form: Form, result: Identification, end: float) -> None:
    report.stage("pictures")
    report.picture("Intervals", lambda: result.plot())
    report.stage("bands")
    limit = _share(end, 0.5, _FOR_A_BAND)
    report.picture(
        "Band of the frequency response, proved", lambda: result.bode(time_limit=limit).plot()
    )
    if form.validation is not None:
        report.stage("validation")
        validation = form.validation
        mode: Mode = "prediction" if float(np.max(form.noise.equation)) > 0 else "simulation"
        title = f"Validation on the rest of the file, {mode}"
        rest = _share(end, 0.9, _FOR_A_BAND)
        report.picture(title, lambda: result.compare(validation, mode, time_limit=rest).plot())


class _Report:
    """Sections and files of a report. Mutable."""

    def __init__(self, folder: Path, parameters: int) -> None:
        self._folder, self._stage, self._parameters = folder, "", parameters
        self._settled: dict[str, bool] = {}
        self.sections: list[dict[str, str]] = []
        self.files: list[str] = []

    def stage(self, name: str) -> None:
        """Say what is being done."""
        self._stage = name
        self._write({})

    def interval(self, name: str, outer: Ends, inner: Ends) -> None:
        """Say what is proved and attained of a parameter so far."""
        gap = max(inner[0] - outer[0], outer[1] - inner[1])
        self._settled[name] = bool(gap <= _CLOSED * (inner[1] - inner[0]))
        self._write({"settled": sum(self._settled.values()), "ends": self._parameters})

    def _write(self, more: dict[str, int]) -> None:
        state = {"stage": self._stage, **more, "sections": self.sections, "files": self.files}
        write_text(self._folder / "progress.json", json.dumps(state))

    def add(self, title: str, content: str) -> None:
        """Add a section of HTML that we made."""
        self.sections.append({"title": title, "html": content})

    def file(self, name: str, make: Callable[[], str]) -> None:
        """Write a file for download, if this result has one."""
        try:
            write_text(self._folder / name, make())
        except _ERRORS as error:  # such as structures without a certificate file
            self.add(name, f"<p>{escape(str(error))}</p>")
        else:
            self.files.append(name)

    def picture(self, title: str, draw: Callable[[], Any]) -> None:
        """Add a picture, or why there is none."""
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot

        try:
            axes = np.ravel(draw())[0]
            out = io.StringIO()
            axes.get_figure(root=True).savefig(out, format="svg", bbox_inches="tight")
            svg = out.getvalue()
            self.add(title, svg[svg.index("<svg") :])
        except _ERRORS as error:
            self.add(title, f"<p>{escape(str(error))}</p>")
        finally:
            pyplot.close("all")
