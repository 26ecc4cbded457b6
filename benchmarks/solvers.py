"""CPU seconds of the clique-tree method and of Clarabel on the same relaxations.

    OMP_NUM_THREADS=1 python -m benchmarks.solvers [--families chains ...] [--largest 1000]

Prints a Markdown table. The seconds of the clique-tree method are those of a solve with the
analysis known; the analysis, which serves all objectives of a relaxation, has its own column.
Both solvers stop where they do by default. ``loss`` is the distance of each safe value from
the better one, relative to max(1, |value|), in the best of Clarabel's two forms.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

import sparsepop_py as sp
from sparsepop_py.conic import ConicProgram
from sparsepop_py.solvers import cliquetree, solve_conic

Case = tuple[str, int, Callable[[], ConicProgram]]


def chains(largest: int) -> Iterator[Case]:
    """Order-2 relaxations of chains on the box [-1, 1]^n."""
    for make in (
        sp.problems.rosenbrock,
        sp.problems.chained_wood,
        sp.problems.broyden_tridiagonal,
        sp.problems.chained_singular,
    ):
        for n in (n for n in (20, 100, 500, 1000, 2000, 5000, 10000) if n <= largest):
            yield make.__name__, n, lambda make=make, n=n: _on_the_box(make(n).objective, 2)


def blocks(largest: int) -> Iterator[Case]:
    """Quartics on paths of overlapping cliques of growing size, order 2; trees, order 3."""
    for size in (3, 4, 5, 6, 7, 8):
        for count in (1, 4, 16):
            if size * count <= min(largest, 64):
                yield f"cliques of {size}", count, lambda s=size, c=count: _path(s, c)
    for n in (10, 40, 160):
        if n <= largest:
            yield "tree, order 3", n, lambda n=n: _tree(n)


def identification(largest: int) -> Iterator[Case]:
    """Bounds on a parameter from noisy records of N samples."""
    for n in (n for n in (10, 20, 50, 100, 200, 500) if n <= largest):
        yield "output error, order 1", n, lambda n=n: _record(n, 1, lean=True, products=True)
        yield "output error, lean 2", n, lambda n=n: _record(n, 2, lean=True)
        if n <= 20:
            yield "output error, order 2", n, lambda n=n: _record(n, 2)
        if n <= 100:
            yield "first order, order 2", n, lambda n=n: _record(n, 2, parameters=2)


FAMILIES = {"chains": chains, "blocks": blocks, "identification": identification}


def _on_the_box(objective: sp.Polynomial, order: int) -> ConicProgram:
    problem = sp.Problem(objective, lower=-1, upper=1)
    return sp.assemble(sp.relax(problem, order), objective)


def _path(size: int, count: int) -> ConicProgram:
    """Cliques that share two variables with the next one, a dense quartic on each."""
    rng = np.random.default_rng(size)
    x = sp.variables(count * (size - 2) + 2)
    parts = []
    for k in range(count):
        clique = x[k * (size - 2) : k * (size - 2) + size]
        for _ in range(3):
            form = sp.total([float(rng.normal()) * v for v in clique])
            parts.append((form**2 - float(rng.uniform(0, 1))) ** 2)
        parts += [float(rng.normal()) * v for v in clique]
    return _on_the_box(sp.total(parts), 2)


def _tree(n: int) -> ConicProgram:
    rng = np.random.default_rng(n)
    x = sp.variables(n)
    parts = [float(rng.normal()) * v for v in x]
    for i in range(1, n):
        j = int(rng.integers(0, i))
        parts += [(x[i] - float(rng.normal()) * x[j] ** 2) ** 2, float(rng.normal()) * x[i] * x[j]]
    return _on_the_box(sp.total(parts), 3)


def _record(samples: int, order: int, *, parameters: int = 5, **options: bool) -> ConicProgram:
    """y_k + a1 y_{k-1} + a2 y_{k-2} = b0 u_k + b1 u_{k-1} + b2 u_{k-2}, y = eta + noise."""
    rng = np.random.default_rng(0)
    true = [-1.1, 0.4, 0.0, 0.6, 0.3] if parameters == 5 else [-0.6, 0.5]
    poles, gains = (2, 3) if parameters == 5 else (1, 1)
    u, noise = rng.choice([-1.0, 1.0], samples), 0.05
    clean = np.zeros(samples)
    lag = max(poles, gains - 1)
    for k in range(lag, samples):
        clean[k] = sum(true[poles + j] * u[k - j] for j in range(gains)) - sum(
            true[j] * clean[k - 1 - j] for j in range(poles)
        )
    y = clean + rng.uniform(-noise, noise, samples)
    x = sp.variables(parameters + samples)
    theta = [t + 0.3 * v for t, v in zip(true, x[:parameters], strict=True)]
    eta = [float(y[k]) - noise * x[parameters + k] for k in range(samples)]
    rows = []
    for k in range(lag, samples):
        left = sp.total([eta[k], *(theta[j] * eta[k - 1 - j] for j in range(poles))])
        right = sp.total([theta[poles + j] * float(u[k - j]) for j in range(gains)])
        rows.append((left - right) * 0.5 == 0)
    problem = sp.Problem(x[0], rows, lower=-1, upper=1)
    return sp.assemble(sp.relax(problem, order, **options), problem.objective)


def _safe(program: ConicProgram, z: np.ndarray) -> float:
    """Dual value less the largest effect of the residual and of eigenvalues below zero."""
    cones, loss = program.cones, float(np.abs(program.q + program.A.T @ z).sum())
    offset = cones.zero + cones.nonnegative
    loss += 2 * float(np.maximum(0.0, -z[cones.zero : offset]).sum())
    for size in cones.psd:
        j, i = np.tril_indices(size)
        matrix = np.zeros((size, size))
        matrix[j, i] = z[offset : offset + i.size] * np.where(i == j, 1.0, np.sqrt(0.5))
        loss += size * max(0.0, -float(np.linalg.eigvalsh(matrix)[0]))
        offset += i.size
    return program.offset - float(program.b @ z) - loss


def _row(family: str, size: int, program: ConicProgram) -> tuple[list[str], float]:
    begin = time.process_time()
    symbolic = cliquetree.analyse(program)
    analysis = time.process_time() - begin
    own = cliquetree.solve(program, symbolic)
    others = [solve_conic(program, form) for form in ("clarabel", "clarabel-moment")]
    usable = [s for s in others if s.status in ("solved", "almost", own.status)]
    fastest = min(s.seconds for s in usable or others)
    values = [_safe(program, own.z), max(_safe(program, s.z) for s in others)]
    scale = max(1.0, abs(own.primal))
    losses = [f"{(max(values) - value) / scale:.0e}" for value in values]
    ratio = fastest / own.seconds
    cells = [
        family,
        str(size),
        f"{len(program.cones.psd)} / {max(program.cones.psd, default=0)}",
        str(program.q.size),
        f"{own.status} {own.iterations}",
        f"{own.seconds:.2f}",
        f"{analysis:.2f}",
        " ".join(f"{s.status} {s.seconds:.2f}" for s in others),
        f"{ratio:.1f}",
        *losses,
    ]
    return cells, ratio


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.solvers", description=__doc__)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--largest", type=int, default=1000, help="largest n or N")
    chosen = parser.parse_args()
    head = ["family", "n", "blocks / largest", "moments", "clique tree", "CPU s", "analysis s"]
    head += ["Clarabel: squares, moment form", "ratio", "loss", "Clarabel's loss"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name in chosen.families:
        ratios = []
        for family, size, build in FAMILIES[name](chosen.largest):
            cells, ratio = _row(family, size, build())
            ratios.append(ratio)
            print("| " + " | ".join(cells) + " |", flush=True)
        mean = float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0
        print(f"\n{name}: geometric mean of the ratios {mean:.1f}, least {min(ratios):.1f}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
