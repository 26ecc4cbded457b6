"""Files of a release agree on version and dependencies."""

from __future__ import annotations

import re
import runpy
import shutil
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("CITATION.cff", r"^version: (.*)$"),
        ("packaging/conda/recipe.yaml", r'^  version: "(.*)"$'),
    ],
)
def test_versions_agree(name: str, pattern: str) -> None:
    assert re.findall(pattern, text(name), re.M) == [PROJECT["version"]]


def test_the_recipe_needs_what_the_project_needs() -> None:
    run = text("packaging/conda/recipe.yaml").split("  run:\n")[1].split("\n\n")[0]
    found = {line.strip("- ").replace(" ", "") for line in run.splitlines()}
    assert found == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_the_workflow_runs_every_supported_python() -> None:
    supported = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    matrix = re.search(r"python: \[(.*)\]", text(".github/workflows/ci.yml"))
    assert matrix is not None
    assert re.findall(r"3\.\d+", matrix[1]) == supported == ["3.11", "3.12", "3.13", "3.14"]


HOSTS = re.compile(
    r"https://[\w.-]*(?:sparsepop-py|sparsepop_py)[\w./-]*|https://github\.com/[\w./-]+"
)


def test_addresses_are_those_of_the_project() -> None:
    """Badges, workflows' actions and other projects are no addresses of ours."""
    urls = PROJECT["urls"]
    assert set(urls) == {"Homepage", "Documentation", "Changelog", "Issues"}
    ours = (urls["Homepage"], urls["Documentation"])
    assert urls["Changelog"].startswith(ours[0]) and urls["Issues"].startswith(ours[0])
    for name in ("README.md", "packaging/conda/recipe.yaml"):
        found = HOSTS.findall(text(name))
        assert found and [address for address in found if not address.startswith(ours)] == []


def test_no_other_file_holds_the_addresses() -> None:
    """They would stay behind when the project moves."""
    homes = [PROJECT["urls"][name].rstrip("/") for name in ("Homepage", "Documentation")]
    listed = ("pyproject.toml", "README.md", "packaging/conda/recipe.yaml")
    folders = ("docs", "sparsepop_py", "setid", "examples", "packaging", ".github", "matlab")
    files = [
        ROOT / name for name in ("mkdocs.yml", "CITATION.cff", "CONTRIBUTING.md", "SECURITY.md")
    ]
    files += [p for folder in folders for p in (ROOT / folder).rglob("*") if p.is_file()]
    held = [
        path.relative_to(ROOT).as_posix()
        for path in files
        if path.suffix not in (".pyc", ".png", ".svg")
        and any(home.encode() in path.read_bytes() for home in homes)
    ]
    assert [name for name in held if name not in listed] == []


def test_the_project_moves(tmp_path: Path) -> None:
    for name in ("pyproject.toml", "README.md", "packaging/conda/recipe.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    move = runpy.run_path(str(ROOT / "packaging" / "addresses.py"))["move"]
    move(tmp_path, "https://example.org/a/b", "https://example.org/site/")
    moved = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]["urls"]
    assert moved["Documentation"] == "https://example.org/site/"
    assert moved["Issues"] == "https://example.org/a/b/issues"
    for path in tmp_path.rglob("*.*"):
        if path.is_file():
            assert PROJECT["urls"]["Homepage"] not in path.read_text(encoding="utf-8")
    assert "](https://example.org/a/b/blob/main/" in (tmp_path / "README.md").read_text()


def test_the_start_page_names_the_wheel() -> None:
    wheels = set(re.findall(r"sparsepop_py-(.*?)-py3-none-any\.whl", text("docs/start/README.md")))
    assert wheels == {PROJECT["version"]}
    assert f"sparsepop_py-{PROJECT['version']}-py3" in text("docs/matlab.md")


def test_paths_that_the_files_name_exist() -> None:
    for name in (".github/workflows/ci.yml", "Dockerfile"):
        copied = re.findall(r"^COPY (.*) \S+$", text(name), re.M)
        named = [part for line in copied for part in line.split()]
        named += re.findall(r"tests/[\w/.]+", text(name))
        assert named
        assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_dockerfile_is_short() -> None:
    lines = [line for line in text("Dockerfile").splitlines() if line and not line.startswith("#")]
    assert len(lines) <= 20
