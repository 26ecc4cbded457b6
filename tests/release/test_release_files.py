"""Files of a release agree on version and dependencies."""

from __future__ import annotations

import re
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
