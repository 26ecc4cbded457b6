"""Run one measurement by name and print its table."""

from __future__ import annotations

import argparse
import resource
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import sparsepop_py as sp
from sparsepop_py.display import rounded

ZOO = Path(__file__).resolve().parent.parent / "tests" / "zoo"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    growth = commands.add_parser("growth", help="build and assemble chains of growing length")
    growth.add_argument("--sizes", type=int, nargs="+", default=[1000, 2000, 5000, 10000])
    proofs = commands.add_parser("certificates", help="bounds, corrections and verification")
    proofs.add_argument("--names", nargs="*", help="only problems whose name contains one of these")
    chosen = parser.parse_args()
    rows = _growth(chosen.sizes) if chosen.command == "growth" else _certificates(chosen.names)
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)
    return 0


def _growth(sizes: list[int]) -> Iterator[list[str]]:
    """CPU seconds of cliques, relaxation and assembly at order 2 on the box [-1, 1]^n."""
    yield ["problem", "n", "cliques s", "relax s", "assemble s", "moments", "rows", "peak MB"]
    yield ["---"] * 8
    for make in (sp.problems.rosenbrock, sp.problems.broyden_tridiagonal):
        for n in sizes:
            problem = sp.Problem(make(n).objective, lower=-1, upper=1)
            ticks = [time.process_time()]
            cliques = sp.find_cliques(problem)
            ticks.append(time.process_time())
            relaxation = sp.relax(problem, 2, cliques=cliques)
            ticks.append(time.process_time())
            sp.assemble(relaxation, problem.objective)
            ticks.append(time.process_time())
            seconds = [f"{b - a:.3f}" for a, b in zip(ticks, ticks[1:], strict=False)]
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
            sizes_text = [str(relaxation.moments.shape[0]), str(relaxation.rows), str(peak)]
            yield [make.__name__, str(n), *seconds, *sizes_text]


def _certificates(names: list[str] | None) -> Iterator[list[str]]:
    """The zoo: proved and attained values, what the proof cost, and time to solve and verify."""
    yield ["problem", "order", "status", "proved", "attained", "gap", "correction", "s", "verify s"]
    yield ["---"] * 9
    for name, text, order in _zoo():
        if names and not any(part in name for part in names):
            continue
        problem = sp.parse(text)
        start = time.process_time()
        result = sp.solve(problem, sp.Options(order=order))
        middle = time.process_time()
        correction, verified = "", ""
        if result.certificate is not None:
            assert result.certificate.verify(problem).ok
            correction = f"{result.certificate.correction:.1e}"
            verified = f"{time.process_time() - middle:.3f}"
        yield [
            name,
            str(order),
            str(result.status),
            rounded(result.lower_bound, False),
            rounded(result.upper_bound, True),
            f"{result.gap:.1e}",
            correction,
            f"{middle - start:.2f}",
            verified,
        ]


def _zoo() -> Iterator[tuple[str, str, int]]:
    for path in sorted(ZOO.glob("*.toml")):
        for entry in tomllib.loads(path.read_text())["problem"]:
            yield entry["name"], entry["text"], max(entry["orders"])


if __name__ == "__main__":
    sys.exit(main())
