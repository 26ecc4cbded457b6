"""CPU seconds of the clique-tree method, Clarabel, CSDP and sdpa-python on the same programs.

    OMP_NUM_THREADS=1 python -m benchmarks.solvers [--families chains ...] [--largest 1000]
                                                   [--peers 60] [--picture solvers.png]

Prints a Markdown table. The seconds of the clique-tree method are those of a solve with the
analysis known; the analysis, which serves all objectives of a relaxation, has its own column.
All solvers stop where they do by default, in turn, and the least of three times counts (of one
for those that take long). ``ratio`` is that of the faster of Clarabel's two forms. ``loss`` is
the distance of each safe value from the better one, relative to max(1, |value|), in the better
of Clarabel's forms. ``--peers`` gives the others so many seconds; those that are not installed
are left out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sparsepop_py as sp
from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.solvers import cliquetree, preferred, solve_conic

from .agreement import safe_value
from .peers.conic import PEERS, Ended
from .problems.relaxations import on_the_box, path, record, star, tree

Case = tuple[str, int, Callable[[], ConicProgram]]
_SHORT = 2.0  # seconds of a solver up to which it runs three times


def chains(largest: int) -> Iterator[Case]:
    """Order-2 relaxations of chains on the box [-1, 1]^n."""
    for make in (
        sp.problems.rosenbrock,
        sp.problems.chained_wood,
        sp.problems.broyden_tridiagonal,
        sp.problems.chained_singular,
    ):
        for n in (n for n in (20, 100, 500, 1000, 2000, 5000, 10000) if n <= largest):
            yield make.__name__, n, lambda make=make, n=n: on_the_box(make(n).objective, 2)


def blocks(largest: int) -> Iterator[Case]:
    """Quartics on paths of overlapping cliques of growing size, order 2; trees, order 3."""
    for size in (3, 4, 5, 6, 7, 8):
        for count in (1, 4, 16):
            if size * count <= min(largest, 64):
                yield f"cliques of {size}", count, lambda s=size, c=count: path(s, c)
    for n in (10, 40, 160):
        if n <= largest:
            yield "tree, order 3", n, lambda n=n: tree(n)


def identification(largest: int) -> Iterator[Case]:
    """Bounds on a parameter from noisy records of N samples."""
    for n in (n for n in (20, 50, 100, 200, 500) if n <= largest):
        for kind in ("oe", "eiv"):
            for shape in ("star", "split"):
                if n <= (500 if kind == "oe" else 200) and (n <= 100 or shape == "star"):
                    name = f"{kind}, {shape}"
                    yield name, n, lambda k=kind, n=n, s=shape: star(k, n, s, 5)
    for n in (n for n in (10, 50, 100, 200) if n <= largest):
        yield "second order, lean 2", n, lambda n=n: record(n, 2, lean=True)
        if n <= 100:
            yield "first order, order 2", n, lambda n=n: record(n, 2, parameters=2)
        if n <= 10:
            yield "second order, order 2", n, lambda n=n: record(n, 2)


FAMILIES = {"chains": chains, "blocks": blocks, "identification": identification}


@dataclass(frozen=True)
class Line:
    """All solvers on one program; ``seconds`` of those that solved it, by name."""

    family: str
    size: int
    program: ConicProgram
    own: ConicSolution
    analysis: float
    clarabel: tuple[ConicSolution, ...]
    losses: tuple[float, float]
    peers: dict[str, Ended | None]

    @property
    def reference(self) -> float:
        """Seconds of the faster form of Clarabel that ended with a value."""
        usable = [s for s in self.clarabel if s.status in ("solved", "almost", self.own.status)]
        return min(s.seconds for s in usable or self.clarabel)

    @property
    def ratio(self) -> float:
        """How many times faster than Clarabel."""
        return self.reference / self.own.seconds

    @property
    def block(self) -> int:
        """Rows of the largest semidefinite block."""
        return max(self.program.cones.psd, default=0)

    @property
    def default(self) -> bool:
        """Whether the clique-tree method is what the engine would take."""
        return preferred(self.block, self.program.q.size, True)[0] == "cliquetree"

    def cells(self) -> list[str]:
        """The columns of the table."""
        peers = [
            "-" if e is None else f"{e[0]} {e[2]:.2f}" for e in (self.peers.get(p) for p in PEERS)
        ]
        return [
            self.family,
            str(self.size),
            f"{len(self.program.cones.psd)} / {self.block}",
            str(self.program.q.size),
            f"{self.own.status} {self.own.iterations}",
            f"{self.own.seconds:.3f}",
            f"{self.analysis:.2f}",
            " ".join(f"{s.status} {s.seconds:.2f}" for s in self.clarabel),
            f"{self.ratio:.1f}" + ("" if self.default else " (not default)"),
            *peers,
            *(f"{loss:.0e}" for loss in self.losses),
        ]


def _solve(program: ConicProgram, symbolic: cliquetree.Symbolic, solver: str) -> ConicSolution:
    if solver == "cliquetree":
        return cliquetree.solve(program, symbolic)
    return solve_conic(program, solver)


def measure(family: str, size: int, program: ConicProgram, limit: float, kernels: str) -> Line:
    """All solvers in turn, three times where that is short."""
    compiled = cliquetree.run(program, settings=cliquetree.Settings(kernels=kernels))  # type: ignore
    begin = time.process_time()
    symbolic = cliquetree.analyse(program, compiled.symbolic.compiled)
    analysis = time.process_time() - begin
    best: dict[str, ConicSolution] = {}
    for _ in range(3):
        for solver in ("cliquetree", "clarabel", "clarabel-moment"):
            if solver not in best or best[solver].seconds < _SHORT:
                found = _solve(program, symbolic, solver)
                best[solver] = min(best.get(solver, found), found, key=lambda s: s.seconds)
    own, *others = best.values()
    values = [safe_value(program, own.z), max(safe_value(program, s.z) for s in others)]
    scale = max(1.0, abs(own.primal))
    peers = {name: solve(program, limit) for name, solve in PEERS.items()} if limit else {}
    losses = (max(values) - values[0]) / scale, (max(values) - values[1]) / scale
    return Line(family, size, program, own, analysis, tuple(others), losses, peers)


def picture(lines: list[Line], file: Path) -> None:
    """Seconds over seconds of Clarabel, by size of the largest block."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 5))
    for name, colour, marker in (("cliquetree", "C0", "o"), ("CSDP", "C1", "s")):
        _scatter(axes, lines, name, colour, marker)
    _scatter(axes, lines, "sdpa-python", "C2", "^")
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set(xlabel="rows of the largest block", ylabel="seconds of Clarabel / seconds")
    axes.set(xscale="log", yscale="log")
    axes.legend()
    figure.savefig(file, dpi=150, bbox_inches="tight")


def _scatter(axes, lines: list[Line], name: str, colour: str, marker: str) -> None:
    x, y, area = [], [], []
    for line in lines:
        if name == "cliquetree":
            seconds = line.own.seconds
        else:
            ended = line.peers.get(name)
            if ended is None or ended[0] not in ("solved", "almost"):
                continue
            seconds = ended[2]
        x.append(max(line.block, 1))
        y.append(line.reference / seconds)
        area.append(6 + 2 * np.sqrt(len(line.program.cones.psd)))
    axes.scatter(x, y, area, c=colour, marker=marker, alpha=0.6, label=name)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.solvers", description=__doc__)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--largest", type=int, default=1000, help="largest n or N")
    parser.add_argument("--kernels", choices=("auto", "numpy", "numba"), default="auto")
    parser.add_argument("--peers", type=float, default=0.0, help="seconds for other solvers")
    parser.add_argument("--picture", type=Path, help="file for a plot")
    chosen = parser.parse_args()
    head = ["family", "n", "blocks / largest", "moments", "clique tree", "CPU s", "analysis s"]
    head += ["Clarabel: squares, moment form", "ratio", *PEERS, "loss", "Clarabel's loss"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    every: list[Line] = []
    for name in chosen.families:
        lines = []
        for family, size, build in FAMILIES[name](chosen.largest):
            lines.append(measure(family, size, build(), chosen.peers, chosen.kernels))
            print("| " + " | ".join(lines[-1].cells()) + " |", flush=True)
        for which, some in (("all", lines), ("default", [x for x in lines if x.default])):
            if some:
                ratios = [line.ratio for line in some]
                mean = float(np.exp(np.mean(np.log(ratios))))
                print(f"\n{name}, {which}: geometric mean {mean:.1f}, least {min(ratios):.1f}")
        print()
        every += lines
    if chosen.picture is not None:
        picture(every, chosen.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
