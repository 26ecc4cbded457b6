"""The versions that the lowest environment installs are those that pyproject.toml allows."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def version(text: str) -> tuple[int, ...]:
    numbers = [int(part) for part in text.split(".")]
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def test_the_lowest_versions_are_those_of_pyproject() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *extras["plot"], *extras["cvxpy"], *extras["sympy"]]
    allowed = dict(re.fullmatch(r"([\w-]+)>=([\d.]+)", line).groups() for line in asked)
    lines = (ROOT / "tests" / "lowest.txt").read_text().splitlines()
    pinned = dict(m.groups() for line in lines if (m := re.fullmatch(r"([\w-]+)==([\d.]+)", line)))
    assert pinned.keys() == allowed.keys()
    assert {n: version(v) for n, v in pinned.items()} == {n: version(v) for n, v in allowed.items()}
