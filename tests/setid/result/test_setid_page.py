"""The page on an identification: complete in itself, and its stored result verifies."""

from __future__ import annotations

import base64
import builtins
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from html_cells import Cells
from identified_cases import identified

import setid
import sparsepop_py as sp
from setid.result import page
from sparsepop_py.progress import Line

MODEL = setid.TransferFunction(na=1, nb=1, nk=1)
VOID = {"meta", "img"}  # tags that need no end


class Page(Cells):
    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in VOID:
            super().handle_starttag(tag, attrs)


def record(bound: float) -> setid.IOData:
    u = np.sign(np.sin(0.9 * np.arange(40) ** 1.1))
    truth = setid.simulate_record(MODEL, [-0.7, 1.0], u, setid.Noise(equation=bound), 3)
    return setid.IOData(u, truth.data.y, 0.1, output_names="level & rate", output_units="m")


def test_a_page_is_complete_in_itself(tmp_path: Path) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    data = record(0.05)
    result = setid.identify(data, MODEL, setid.Noise(equation=0.05), [setid.Stable()])
    path = result.report(tmp_path / "out.html", data.split(20)[1])
    text = path.read_text(encoding="utf-8")
    found = Page(text)
    assert "level & rate [m]" not in text and "level &amp; rate" in text
    assert {"a1", "b1", "certified", "best in simulation"} <= set(found.cells)
    for name in ("data", "assumptions", "intervals", "bands", "residuals", "binding", "verify"):
        assert f'id="{name}"' in text
    assert "Verified again" in text and "Not available" not in text
    sources = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert sources and all(source.startswith("data:") for source in sources)
    assert text.count("<figure>") >= 7
    stored = next(s for s in sources if s.startswith("data:application/json"))
    back = setid.Identification.from_json(base64.b64decode(stored.split(",")[1]).decode())
    assert back.verify(data) and repr(back) == repr(result)
    again = result.report(tmp_path / "again.html", data.split(20)[1])
    sizes = [len(Path(p).read_text(encoding="utf-8")) for p in (path, again)]
    assert sizes[0] == sizes[1]


def captions(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    assert "Verified again" in text
    return re.findall(r"<figcaption>([^<]*)</figcaption>", text)


@pytest.mark.slow
def test_a_page_shows_each_pair_of_channels(tmp_path: Path) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    model = setid.TransferFunction(1, 1, 1, inputs=2, common_denominator=True)
    noise = setid.Noise(output=0.05)
    u = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    data = setid.simulate_record(model, [-0.7, 0.5, -0.8], u, noise, 1).data
    options = setid.Options(time_limit=20.0, progress=False)
    result = setid.identify(data, model, noise, setid.Stable(), options)
    path = result.report(tmp_path / "out.html", time_limit=3.0)
    shown = captions(path)
    assert "e1(k)" not in path.read_text(encoding="utf-8")  # there is no equation error
    assert shown.count("gain and phase, proved") == 2
    assert shown.count("response to a unit step, proved") == 2
    assert "prediction: readings and band" in shown and "one-step residuals" in shown[-1]


@pytest.mark.slow
def test_a_page_on_blocks_shows_their_maps_and_what_is_sampled(tmp_path: Path) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    linear, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.05)
    options = setid.Options(time_limit=2.0, progress=False)
    u = np.random.default_rng(0).uniform(-1, 1, (15, 1))
    for model, wanted in (
        (setid.Hammerstein(linear, 2, "gamma1"), "response to a unit step, proved"),
        (setid.Wiener(linear, 2, "gamma1"), "response to a unit step, sampled"),
    ):
        data = setid.simulate_record(model, [-0.6, 0.5, 0.3], u, noise, 1).data
        result = setid.identify(data, model, noise, setid.Stable(), options)
        shown = captions(result.report(tmp_path / "out.html", time_limit=1.0))
        assert wanted in shown
        assert ("static map w, proved" in shown) == ("w" in dict(model.maps))


@pytest.mark.parametrize("limit", [-1.0, np.nan, "20", None, True])
def test_limits_of_pages_are_checked_first(tmp_path: Path, limit: Any) -> None:
    result = setid.identify(record(0.05), MODEL, setid.Noise(equation=0.05))
    with pytest.raises(setid.SetidError, match="time_limit: found"):
        result.report(tmp_path / "out.html", time_limit=limit)
    assert not (tmp_path / "out.html").exists()


def test_works_of_a_page_share_the_time_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(page, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    works = page._Works(3, 30.0, Line(False))
    assert works.begin("one") == 10.0
    clock[0] = 25.0  # it took longer, and the others have less
    assert works.begin("two") == 2.5
    clock[0] = 40.0
    assert works.begin("three") == 0.0
    assert page._Works(2, 100.0, Line(False)).begin("one") == 20.0


@pytest.mark.parametrize("progress", [True, False])
def test_a_page_says_what_it_works_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, progress: bool
) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    drawn: list[str] = []

    class Recorder(Line):
        def __init__(self, show: bool) -> None:
            assert show is progress  # as of the identification

        def draw(self, text: str) -> None:
            drawn.append(text)

        def close(self) -> None:
            drawn.append("closed")

    monkeypatch.setattr(page, "Line", Recorder)
    monkeypatch.setattr(page, "_picture", lambda caption, draw: page.Part("note", caption))
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    result = setid.identify(data, model, noise, options=setid.Options(progress=progress))
    result.report(tmp_path / "out.html", time_limit=1.0)
    assert [text.split(", ")[-1] for text in drawn] == [
        "centre ...",
        "best member in simulation ...",
        "best member in prediction ...",
        "frequency response of y1 from u1 ...",
        "step response of y1 from u1 ...",
        "prediction of the outputs ...",
        "simulation of the outputs ...",
        "verification ...",
        "closed",
    ]
    assert "7/7 parts of the page" in drawn[-2]


def test_a_page_does_not_advise_the_prior_that_was_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    monkeypatch.setattr(page, "_sections", lambda *given: [])
    base = setid.formulate(record(0.05), MODEL, setid.Noise(output=0.05), [setid.Stable()])
    result = identified(base, [(-1.0, 1.0), (-9.0, 9.0)])  # wide, nothing attained
    text = result.report(tmp_path / "out.html").read_text(encoding="utf-8")
    assert "no consistent parameters were found: give more time, or priors such as Box." in text


def test_an_empty_set_gets_a_page_that_says_so(tmp_path: Path) -> None:
    pytest.importorskip("jinja2", reason="pages need jinja2, an optional extra")
    result = setid.identify(record(0.5), MODEL, setid.Noise(equation=0.05))
    text = result.report(tmp_path / "out.html").read_text(encoding="utf-8")
    assert "samples that contradict each other" in text and 'id="bands"' not in text


def test_missing_software_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = builtins.__import__

    def without(name: str, *rest: object, **more: object) -> object:
        if name == "jinja2":
            raise ImportError(name)
        return found(name, *rest, **more)  # type: ignore[arg-type]

    result = setid.identify(record(0.05), MODEL, setid.Noise(equation=0.05))
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(sp.SolverNotFound, match=r"pip install 'sparsepop-py\[report\]'"):
        result.report(tmp_path / "out.html")
