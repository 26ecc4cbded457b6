"""The pages run, their links lead somewhere, and they speak the field's language."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import sparsepop_py as sp

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / room / "README.md" for room in ("sparsepop_py/verified", "setid/proofs", "checker")),
]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
# Python blocks in order; a block of text that follows one is what it prints.
CODE = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.M | re.S)
# Words of an older private language, as whole words outside of code.
PRIVATE = (
    "rungs?|climb(?:s|ed|ing)?|ladders?|squeez(?:e|es|ed|ing)|narrow(?:s|ed|ing)?"
    "|agendas?|told|grounds?|endless|dear(?:er)?"
)

MADE = ("benchmarks/results/",)  # where programs write
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OURS = PROJECT["urls"]["Homepage"] + "/blob/main/"


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def code(name: str) -> list[tuple[str, str]]:
    return CODE.findall(text(name))


WITH_CODE = [name for name in NAMES if name.startswith("docs") and code(name)]


@pytest.mark.parametrize("name", WITH_CODE)
def test_code_of_a_page_runs_and_prints_what_the_page_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for record in (ROOT / "examples" / "data").glob("*.csv"):  # as readers do
        shutil.copy(record, tmp_path)
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {"__name__": "page"}
    for number, (block, shown) in enumerate(code(name)):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block, f"{name} block {number}", "exec", dont_inherit=True), scope)
        assert shown.rstrip() in printed.getvalue(), f"{name} block {number}"


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    inline = re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", text(name))
    defined = re.findall(r"^\[[^\]]+\]: ([^#\s]*)(?:#(\S*))?$", text(name), re.M)
    for target, anchor in inline + defined:
        if "://" in target and not target.startswith(OURS):
            continue
        found = page.parent / target if target else page
        if target.startswith(OURS):
            found = ROOT / target.removeprefix(OURS)
        assert found.exists(), f"{name} links to {target}"
        if anchor and found.suffix == ".md":
            assert anchor in anchors(found), f"{name} links to {target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """The anchors that a Markdown page has, one a heading."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    kept = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in kept}


@pytest.mark.parametrize("name", NAMES)
def test_pages_speak_the_words_of_the_field(name: str) -> None:
    hidden = r"```.*?```|`[^`\n]*`|\]\([^)]*\)|^\[[^\]\n]+\]: \S+$"
    prose = re.sub(hidden, "", text(name), flags=re.S | re.M)
    assert re.findall(rf"\b(?:{PRIVATE})\b", prose, re.I) == []


@pytest.mark.parametrize("name", NAMES)
def test_files_that_pages_name_exist(name: str) -> None:
    named = re.findall(r"`((?:sparsepop_py|setid|tests|benchmarks|examples)/[\w./-]+)`", text(name))
    absent = [path for path in named if path not in MADE and not (ROOT / path).exists()]
    assert absent == []


def test_every_option_is_documented() -> None:
    table = text("docs/parameters.md").split("## Options of solve and solve_each")[1]
    documented = re.findall(r"^\| `(\w+)` \|", table, re.M)
    assert documented == [option.name for option in dataclasses.fields(sp.Options)]


def test_the_design_page_names_every_room() -> None:
    page = text("docs/design.md")
    rooms = [
        path.stem if path.is_file() else f"{path.name}/"
        for package in ("sparsepop_py", "setid")
        for path in (ROOT / package).iterdir()
        if not path.name.startswith("_") and (path.is_dir() or path.suffix == ".py")
    ]
    assert [room for room in rooms if f"`{room}`" not in page] == []


def test_the_page_on_trust_adds_the_lines_up() -> None:
    pages = ("sparsepop_py/verified/README.md", "setid/proofs/README.md")
    counted = [int(re.findall(r"That is (\d+) lines", text(page))[0]) for page in pages]
    stated = [int(number) for number in re.findall(r" on (\d+) lines", text("docs/trust.md"))]
    assert stated == [counted[0], sum(counted)]


def test_every_page_is_listed() -> None:
    listed = {
        (ROOT / folder / target).resolve()
        for folder in ("docs", "docs/start", "docs/benchmarks", "docs/decisions")
        for target in re.findall(r"\]\(([^)#]+\.md)\)", text(f"{folder}/README.md"))
    }
    pages = {path for path in (ROOT / "docs").rglob("*.md") if path.name != "README.md"}
    assert pages - listed == set()


def test_every_page_is_in_the_menu_of_the_site() -> None:
    """Decisions and benchmarks are listed on their own pages."""
    menu = text("mkdocs.yml").split("\nnav:\n")[1]
    pages = [path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")]
    listed = ("decisions/0", "benchmarks/")
    wanted = [page for page in pages if not page.startswith(listed)]
    assert [page for page in wanted if page not in menu] == []


def test_links_of_the_readme_work_where_it_is_copied() -> None:
    """Package indices show it without the files beside it."""
    page = re.sub(r"```.*?```|`[^`\n]*`", "", text("README.md"), flags=re.S)
    targets = re.findall(r"\]\(([^)]*)\)", page) + re.findall(r"^\[.*\]: (.*)$", page, re.M)
    assert [target for target in targets if "://" not in target] == []
    defined = set(re.findall(r"^\[(.*)\]: ", page.lower(), re.M))
    labels = {" ".join(found.split()) for found in re.findall(r"\[([^\]]+)\]", page.lower())}
    assert labels == defined


@pytest.mark.slow
def test_the_site_builds_strictly(tmp_path: Path) -> None:
    pytest.importorskip("mkdocstrings")
    call = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    made = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert made.returncode == 0, made.stderr
    page = (tmp_path / "api" / "sparsepop_py" / "index.html").read_text(encoding="utf-8")
    missing = [name for name in sp.__all__ if f"sparsepop_py.{name}" not in page]
    assert missing == []


def test_every_decision_has_a_date_and_what_was_rejected() -> None:
    for path in (ROOT / "docs/decisions").glob("0*.md"):
        record = path.read_text(encoding="utf-8")
        assert re.search(r"^20\d\d-\d\d-\d\d$", record, re.M), path.name
        headings = re.findall(r"^## (.*)$", record, re.M)
        assert headings[:4] == ["Context", "Decision", "Alternatives rejected", "Measured"]
