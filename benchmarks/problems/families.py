"""The families that ``python -m benchmarks list`` shows."""

from __future__ import annotations

import csv
import itertools
import tomllib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import sparsepop_py as sp

from ..errors import BenchmarkError
from ..measuring.registry import Case, Family, Registry, Selection, Task
from . import (
    block_structured,
    channels,
    identification,
    intervals,
    networks,
    power_flow,
    quadratic,
    random_problems,
    sensors,
)

__all__ = ["REGISTRY"]

ROOT = Path(__file__).resolve().parents[2]
ZOO = ROOT / "tests" / "problems" / "zoo"
EXAMPLES = ROOT / "examples" / "problems"
_BILEVEL = ("ex9_", "ex5_2_", "ex5_4_", "st_e33", "st_bpk", "st_bpv")  # products of flows or duals


def _zoo(selection: Selection) -> Iterator[Case]:
    for path in sorted(ZOO.glob("*.toml")):
        for entry in tomllib.loads(path.read_text(encoding="utf-8"))["problem"]:
            make = partial(_from_text, entry["text"], float(entry["optimum"]))
            yield Case(entry["name"], make)


def _zoo_at_its_order(selection: Selection) -> Iterator[Case]:
    """The zoo, each problem at the largest order that its table lists."""
    for path in sorted(ZOO.glob("*.toml")):
        for entry in tomllib.loads(path.read_text(encoding="utf-8"))["problem"]:
            make = partial(_from_text, entry["text"], float(entry["optimum"]))
            yield Case(entry["name"], make, options={"order": max(entry["orders"])})


def _from_text(text: str, optimum: float | None = None) -> Task:
    return Task.of(sp.parse(text), optimum)


def _from_gms(path: Path) -> Task:
    return Task.of(sp.read_gms(path))


def _examples(selection: Selection) -> Iterator[Case]:
    for path in sorted(EXAMPLES.glob("*.gms")):
        yield Case(path.stem, partial(_from_gms, path))


def _files(selection: Selection) -> Iterator[Case]:
    if not selection.files:
        raise BenchmarkError("--files: found none, expected .gms files or .csv tables of problems")
    for path in selection.files:
        if path.suffix == ".gms":
            yield Case(path.stem, partial(_from_gms, path))
        elif path.suffix == ".csv":
            yield from _table(path)
        else:
            raise BenchmarkError(f"--files: found {path.name!r}, expected a name in .gms or .csv")


def _table(path: Path) -> Iterator[Case]:
    """Problems of a table with columns name, problem and, where known, global_optimum."""
    with path.open(newline="", encoding="utf-8") as file:
        for number, entry in enumerate(csv.DictReader(file), 2):
            if not entry.get("name") or not entry.get("problem"):
                raise BenchmarkError(
                    f"{path.name}, line {number}: expected columns 'name' and 'problem'"
                )
            optimum = _number(entry.get("global_optimum"))
            yield Case(entry["name"], partial(_from_text, entry["problem"], optimum))


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _pooling(selection: Selection) -> Iterator[Case]:
    """Pooling and separation networks, and the bilinear and bilevel problems of other families."""
    for number, (price, cap, profit) in enumerate(
        [(16.0, 100.0, 400.0), (16.0, 600.0, 600.0), (13.0, 100.0, 750.0)], 1
    ):
        yield Case(f"haverly{number}", partial(networks.haverly, price, cap, profit))
    yield Case("ex5_2_5", networks.pooling)
    yield Case("ex5_3_2", networks.separation)
    for path in (EXAMPLES / "pooling.gms", EXAMPLES / "complementarity.gms"):
        yield Case(path.stem, partial(_from_gms, path))
    yield from (case for case in _zoo(selection) if case.name.startswith(_BILEVEL))


def _quartics(selection: Selection) -> Iterator[Case]:
    """Dense quartics on [-1, 1]^n with a planted minimiser of value 1."""
    for n, seed in itertools.product(selection.sizes or range(6, 11), selection.seeds):
        yield Case(f"quartic n={n}", partial(_quartic, n, seed), n, seed)


def _quartic(n: int, seed: int) -> Task:
    return Task.of(sp.problems.random_quartic(n, seed=seed), 1.0)


def _box_programs(selection: Selection) -> Iterator[Case]:
    """Quadratic programs over the unit box; dense ones up to 30 variables."""
    for n, seed in itertools.product(selection.sizes or (20, 30, 40, 50), selection.seeds):
        for density in (0.3, 1.0) if n <= 30 else (0.3,):
            make = partial(quadratic.box_program, n, density, seed)
            yield Case(f"box program, density {density:g}", make, n, seed)


def _maximum_cuts(selection: Selection) -> Iterator[Case]:
    """Maximum cuts of random graphs with three edges at each node, an even number of nodes."""
    for n, seed in itertools.product(selection.sizes or (20, 40, 60), selection.seeds):
        yield Case("maximum cut", partial(quadratic.maximum_cut, n, 3, seed), n, seed)


def _sensors(selection: Selection) -> Iterator[Case]:
    for n, seed in itertools.product(selection.sizes or (5, 10, 20), selection.seeds):
        yield Case("sensor network", partial(sensors.localisation, n, 0.4, seed), n, seed)


def _power_flow(selection: Selection) -> Iterator[Case]:
    for ratings, name in ((False, "14 buses"), (True, "14 buses, lines with ratings")):
        yield Case(name, partial(power_flow.power_flow, ratings), 14)


def _broyden(selection: Selection) -> Iterator[Case]:
    for n in selection.sizes or (100, 200, 500, 1000):
        yield Case(f"broyden tridiagonal n={n}", partial(_broyden_task, n), n)


def _broyden_task(n: int) -> Task:
    return Task.of(sp.problems.broyden_tridiagonal(n), 0.0)


def _growth(selection: Selection) -> Iterator[Case]:
    """Chains on the box [-1, 1]^n, of which only sizes and building times are of interest."""
    for make in (sp.problems.rosenbrock, sp.problems.broyden_tridiagonal):
        for n in selection.sizes or (1000, 2000, 5000, 10000):
            yield Case(make.__name__, partial(_boxed, make, n), n, options={"order": 2})


def _boxed(make: Callable[[int], sp.Problem], n: int) -> Task:
    return Task.of(sp.Problem(make(n).objective, lower=-1, upper=1))


_AUTO = {"effort": "auto"}
_WIDTH = {"effort": "auto", "gap": 1e-3}  # relative to the width, see measure.py

REGISTRY = Registry(
    [
        Family(
            "oe",
            "output-error records: ten parameter bounds to 1e-3 of the width (sizes: samples)",
            partial(identification.cases, "oe", -1.0),
            options=_WIDTH,
        ),
        Family(
            "eiv",
            "errors-in-variables records, likewise",
            partial(identification.cases, "eiv", -1.0),
            options=_WIDTH,
        ),
        Family(
            "oe_positive",
            "output-error records with inputs in [0, 1]",
            partial(identification.cases, "oe", 0.0),
            options=_WIDTH,
        ),
        Family(
            "eiv_positive",
            "errors-in-variables records with inputs in [0, 1]",
            partial(identification.cases, "eiv", 0.0),
            options=_WIDTH,
        ),
        Family(
            "block_structured",
            "Hammerstein, Wiener, Lur'e and two-input records, on boxes from the data",
            block_structured.cases,
            "identify",
            options=_WIDTH,
            peer_limit=10.0,
        ),
        Family(
            "channels",
            "records of several inputs and outputs with denominators of their own",
            channels.cases,
            "identify",
            options=_WIDTH,
            peer_limit=10.0,
        ),
        Family(
            "identify",
            "setid on simulated records of order 1 to 3, errors of 1, 5, 10 % (--noise)",
            partial(intervals.cases, False),
            "identify",
            options=_WIDTH,
            peer_limit=20.0,
        ),
        Family(
            "identify-stable",
            "the same, with stability as a prior",
            partial(intervals.cases, True),
            "identify",
            options=_WIDTH,
            peer_limit=20.0,
        ),
        Family(
            "zoo", "problems with known optima, order chosen by the engine", _zoo, options=_AUTO
        ),
        Family("certificates", "the zoo at its listed order: what proofs cost", _zoo_at_its_order),
        Family("examples", "the example files examples/problems/*.gms", _examples, options=_AUTO),
        Family("files", "your own --files: .gms, or .csv tables of texts", _files, options=_AUTO),
        Family("pooling", "pooling and bilevel problems", _pooling, options=_AUTO),
        Family("quartics", "dense quartics on the box (sizes: variables)", _quartics),
        Family(
            "box_programs",
            "quadratic programs over the unit box (sizes: variables)",
            _box_programs,
            options=_AUTO,
        ),
        Family(
            "maximum_cuts",
            "maximum cuts of cubic graphs (sizes: nodes)",
            _maximum_cuts,
            options=_AUTO,
        ),
        Family(
            "sensors",
            "sensor networks, distances to neighbours (sizes: sensors)",
            _sensors,
            options=_AUTO,
        ),
        Family("power_flow", "optimal power flow with 14 buses", _power_flow, options=_AUTO),
        Family("broyden", "Broyden tridiagonal, gap 1e-6 (sizes: variables)", _broyden),
        Family(
            "growth", "build and assemble chains, no solver (sizes: variables)", _growth, "build"
        ),
        Family(
            "random",
            "random problems against sampling, damaged certificates and SCIP (--count)",
            random_problems.cases,
            "random",
            options={"effort": "presolve", "time_limit": 20.0},
            peer_limit=2.0,
        ),
    ]
)
