"""One self-contained page on an identification: what was measured, assumed and proved."""

from __future__ import annotations

import base64
import io
import logging
import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sparsepop_py as sp
from setid.bands.blocks import static_band
from setid.bands.comparison import compare
from setid.bands.outputs import Mode
from setid.bands.residuals import residuals
from setid.bands.responses import frequency_band
from setid.bands.steps import step_band
from setid.data.checks import seconds_of
from setid.data.digits import all_digits
from setid.data.record import IOData
from setid.errors import SetidError
from setid.feasible_points.best import best
from setid.feasible_points.modelled_outputs import per_cent
from setid.formulation.regression import check_channels
from setid.html import table
from setid.models.block import BlockStructured
from setid.models.html import InNotebook, equations_html
from setid.plots.axes import require_matplotlib
from setid.result.identification import Identification
from setid.result.json_ import to_json
from setid.result.reports import advice, binding_kinds, conflict, html
from sparsepop_py.errors import check_writable
from sparsepop_py.files import as_path, write_text
from sparsepop_py.progress import Line

if TYPE_CHECKING:
    import jinja2

__all__ = ["report"]

_STEPS = 50  # samples of a step response
_MOST_STORED = 8_000_000  # characters of the stored result that a page carries
_MOST_BINDING = 12  # samples named
_MOST_PAIRS = 9  # pairs of channels whose responses are drawn
_MOST_SECONDS = 20.0  # for one estimate, band or comparison
_BAR = 24  # characters of the progress line

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Part:
    """A piece of a section: HTML, a picture, a list, code or a note."""

    kind: str
    text: Any
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A title with the parts below it."""

    name: str
    title: str
    parts: tuple[Part, ...]


def report(
    result: Identification,
    path: str | os.PathLike[str],
    validation: IOData | None = None,
    time_limit: float = 60.0,
) -> Path:
    """Write one self-contained page on an identification.

    Parameters
    ----------
    result : Identification
    path : path-like
        Of the page, HTML with its pictures inside.
    validation : IOData, optional
        A record to compare with; that of the identification when left out.
    time_limit : float
        Seconds for the centre, the best members, all bands and comparisons together. Each has an
        equal share of what is left, and 20 seconds at most. One whose time is over ends the step
        that it has begun: of a band that may take 5 seconds, and on long records more. Pictures,
        the stored result and its verification come on top.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    SetidError
        If the time limit is no number of seconds, or the record has other channels.
    SolverNotFound
        If jinja2 or matplotlib is missing; the message says how to install them.
    SparsePOPError
        If the page cannot be written there.
    """
    seconds_of(time_limit)
    if validation is not None:
        check_channels(validation, result.formulation.model)
    check_writable(str(as_path(path)), "path")
    environment, plt = require_software()
    pairs = [] if result.empty else _pairs(result)
    count = 1 if result.empty else 2 * len(pairs) + 5
    works = _Works(count, time_limit, Line(result.options.progress))
    try:
        with plt.style.context("default"):
            said = advice(result, result._remarks(), works.begin("centre"))
            sections = _sections(result, validation, pairs, works, said)
        works.begin("verification")
        verdict = result.verify()
    finally:
        works.line.close()
    page = environment.from_string(
        (files("setid.result") / "page.html").read_text(encoding="utf-8")
    ).render(
        title=f"Identification of {_named(result.formulation.data)}",
        verdict=f"{_of_status(result, said)} "
        + ("Verified again for this page." if verdict else f"NOT VERIFIED: {verdict.reason}"),
        sections=sections,
    )
    write_text(path, page)
    return Path(path)


def _of_status(result: Identification, said: list[str]) -> str:
    """Take the sentence on the status from the advice, which does not advise what was used."""
    lines = [line for line in said if line.startswith(f"{result.status}: ")]
    return lines[0] if lines else f"{result.status}: {result.status.message}"


def require_software() -> tuple[jinja2.Environment, Any]:
    """Import what makes pages: an environment of jinja2, and pyplot of matplotlib.

    Raises
    ------
    SolverNotFound
        If one is missing; the message says how to install it.
    """
    return _environment(), require_matplotlib()


def _environment() -> jinja2.Environment:
    try:
        import jinja2
    except ImportError as error:
        raise sp.SolverNotFound(
            "report: jinja2 is missing; install it with: pip install 'sparsepop-py[report]'"
        ) from error
    return jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)


def _named(data: IOData) -> str:
    return f"{', '.join(data.output_names)} from {', '.join(data.input_names)}"


class _Works:
    """Time and progress of what a page needs. Mutable.

    Parameters
    ----------
    count : int
        Works that are to come.
    time_limit : float
        Seconds for them together.
    line : Line
        Where their names are shown.
    """

    def __init__(self, count: int, time_limit: float, line: Line) -> None:
        self.line, self._count, self._done = line, count, 0
        self._until = time.monotonic() + time_limit

    def begin(self, name: str) -> float:
        """Show and log a work by its name; returns the seconds that it has."""
        full = round(_BAR * self._done / self._count)
        shown = f"[{'#' * full}{'.' * (_BAR - full)}] {self._done}/{self._count} parts of the page"
        self.line.draw(f"{shown}, {name} ...")
        _LOG.debug("report: %s", name)
        left = max(self._until - time.monotonic(), 0.0) / max(self._count - self._done, 1)
        self._done = min(self._done + 1, self._count)
        return min(left, _MOST_SECONDS)


# ---- sections ---------------------------------------------------------------------------


def _sections(
    result: Identification,
    validation: IOData | None,
    pairs: list[tuple[int, int]],
    works: _Works,
    said: list[str],
) -> list[Section]:
    formulation = result.formulation
    remarks = result._remarks()
    found = [
        Section(
            "data",
            "Data",
            (
                Part("html", formulation.data._repr_html_()),
                _picture("record", formulation.data.plot),
            ),
        ),
        Section(
            "assumptions",
            "What is taken for granted",
            (
                _structure(result),
                Part("list", [_noise(result), *result.assumptions]),
                Part("note", "If one of these is false for the plant, so may be what follows."),
            ),
        ),
        Section(
            "intervals",
            "Intervals of the parameters",
            (
                Part("html", html(result, remarks, said)),
                _picture("outer and inner intervals", result.plot),
            ),
        ),
    ]
    if not result.empty:
        found += _uses(result, validation, pairs, works)
    found += [
        Section("binding", "What binds", _binding(result)),
        Section("narrowing", "What would narrow the intervals", (Part("list", said),)),
        Section("verify", "How to verify this", _verification(result)),
    ]
    return found


def _uses(
    result: Identification,
    validation: IOData | None,
    pairs: list[tuple[int, int]],
    works: _Works,
) -> list[Section]:
    """Estimates, bands and residuals of a set with members."""
    about = "the validation record" if validation is not None else "the record itself"
    modes: tuple[Mode, ...] = ("prediction", "simulation")
    estimates = _guarded(lambda: _estimates(result, works))
    bands = _bands(result, pairs, works)
    outputs = [p for mode in modes for p in _guarded(_compared, result, validation, mode, works)]
    return [
        Section("estimates", "Members to work with", tuple(estimates)),
        Section("bands", "Bands of all consistent models", bands),
        Section("outputs", f"Outputs on {about}", tuple(outputs)),
        Section("residuals", "Residuals", tuple(_guarded(lambda: [_residuals(result)]))),
    ]


def _pairs(result: Identification) -> list[tuple[int, int]]:
    """Outputs and inputs, from 1, whose responses are drawn."""
    model = result.formulation.model
    every = [(i, j) for i in range(1, model.outputs + 1) for j in range(1, model.inputs + 1)]
    return every[:_MOST_PAIRS]


def _bands(result: Identification, pairs: list[tuple[int, int]], works: _Works) -> tuple[Part, ...]:
    """Responses of each pair of channels, and static maps."""
    drawn = [partial(work, result, *pair, works) for pair in pairs for work in (_bode, _step)]
    model, found = result.formulation.model, []
    if isinstance(model, BlockStructured):
        drawn += [partial(_static, result, name) for name, _ in model.maps]
    for work in drawn:
        found += [part for part in _guarded(work) if part not in found]  # one note for all pairs
    left = model.outputs * model.inputs - len(pairs)
    if left:
        found.append(Part("note", f"{left} more pairs of channels are not drawn."))
    return tuple(found)


def _bode(result: Identification, output: int, input: int, works: _Works) -> list[Part]:
    seconds = works.begin(f"frequency response of y{output} from u{input}")
    band = frequency_band(result, output=output, input=input, time_limit=seconds)
    return [_picture(f"gain and phase, {band.kind}", band.plot)]


def _step(result: Identification, output: int, input: int, works: _Works) -> list[Part]:
    seconds = works.begin(f"step response of y{output} from u{input}")
    drawn = partial(step_band, result, _STEPS, output=output, input=input)
    try:
        band = drawn(time_limit=seconds)
    except SetidError:
        band = drawn(kind="sampled", time_limit=seconds)
    return [_picture(f"response to a unit step, {band.kind}", band.plot)]


def _static(result: Identification, name: str) -> list[Part]:
    band = static_band(result, name)
    return [_picture(f"static map {name}, {band.kind}", band.plot)]


def _residuals(result: Identification) -> Part:
    caption = "one-step residuals as shares of the largest that noise explains"
    return _picture(caption, residuals(result).plot)


def _estimates(result: Identification, works: _Works) -> list[Part]:
    rows, notes = [], []
    names = result.formulation.parameters
    if result.middle is not None:
        rows.append(("centre of the box", *(f"{v:.6g}" for v in result.middle), ""))
    goals: tuple[Mode, ...] = ("simulation", "prediction")
    for goal in goals:
        seconds = works.begin(f"best member in {goal}")
        try:
            member = best(result, goal, seconds)
        except SetidError as error:
            notes.append(Part("note", f"best in {goal}: {error}"))
            continue
        fits = per_cent(member.fit)
        rows.append((f"best in {goal}", *(f"{v:.6g}" for v in member.theta), fits))
    return [Part("html", table(["estimate", *names, "fit"], rows)), *notes]


def _compared(
    result: Identification, validation: IOData | None, mode: Mode, works: _Works
) -> list[Part]:
    seconds = works.begin(f"{mode} of the outputs")
    found = compare(result, validation, mode, time_limit=seconds)
    return [Part("code", found.summary()), _picture(f"{mode}: readings and band", found.plot)]


def _binding(result: Identification) -> tuple[Part, ...]:
    items = [
        f"prior {text}: {'active' if on else 'not active'}" for text, on in result.active.items()
    ]
    kinds = binding_kinds(result)
    items += [
        f"{kind}: at its bound {count} times where ends are attained"
        for kind, count in kinds.items()
    ]
    for record, sample, count in result.binding()[:_MOST_BINDING]:
        place = f"record {record}, " if result.formulation.data.records > 1 else ""
        items.append(f"{place}sample {sample}: at its bound at {count} ends")
    if result.samples:
        items.append(conflict(result.samples, result.formulation))
    return (
        (Part("list", items),)
        if items
        else (Part("note", "No attained end: nothing is known of it."),)
    )


def _verification(result: Identification) -> tuple[Part, ...]:
    parts = [
        Part(
            "note",
            "Every finite outer end has a certificate and every inner end a point whose existence "
            "is proved; that a set is empty or unbounded has a proof of its own. They are checked "
            "again from the record, without any solver:",
        ),
        Part(
            "code",
            'import pathlib, setid\n\ntext = pathlib.Path("result.json").read_text()\n'
            "result = setid.Identification.from_json(text)  # refuses what does not follow\n"
            "print(result.verify(), result.table())",
        ),
        Part("note", f"fingerprint of the problem: {result.problem.fingerprint}"),
    ]
    try:
        text = to_json(result)
    except SetidError as error:
        return (*parts, Part("note", f"The result has no text: {error}"))
    if len(text) > _MOST_STORED:
        return (
            *parts,
            Part("note", "The result is too large for this page: write result.to_json()."),
        )
    stored = base64.b64encode(text.encode()).decode()
    link = f'<a download="result.json" href="data:application/json;base64,{stored}">result.json</a>'
    return (*parts, Part("html", f"<p>{link}, with record, intervals and evidence</p>"))


def _noise(result: Identification) -> str:
    bounds = result.formulation.noise.bounds(result.formulation.data)
    kinds = ("output noise", "input noise", "equation errors")
    shown = [
        f"{kind} within {_range(b)}" for kind, b in zip(kinds, bounds, strict=True) if np.any(b > 0)
    ]
    return "; ".join(shown) or "no noise"


def _range(bound: Any) -> str:
    low, high = float(np.min(bound)), float(np.max(bound))
    return all_digits(high) if low == high else f"{all_digits(low)} to {all_digits(high)}"


def _structure(result: Identification) -> Part:
    """Equations, of structures that show them; with errors only where these have a bound."""
    model: Any = result.formulation.model
    shown = isinstance(model, InNotebook)
    if not shown:
        return Part("note", repr(model))
    errors = bool(np.any(np.asarray(result.formulation.noise.equation) > 0))
    return Part("html", equations_html(model, errors))


# ---- pictures ---------------------------------------------------------------------------


def _guarded(work: Callable[..., Iterable[Part]], *given: Any) -> list[Part]:
    """Parts, or a note why there are none."""
    try:
        return list(work(*given))
    except (SetidError, sp.ProblemError) as error:
        return [Part("note", f"Not available: {error}")]


def _picture(caption: str, draw: Callable[[], Any]) -> Part:
    """A picture as a data URI, in an image of its own so that names in it clash with none."""
    plt = require_matplotlib()
    axes = np.ravel(np.asarray(draw(), object))
    figure = axes[0].figure
    buffer = io.BytesIO()
    try:
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    finally:
        plt.close(figure)
    text = base64.b64encode(buffer.getvalue()).decode()
    return Part("picture", f"data:image/svg+xml;base64,{text}", caption)
