"""Relaxations of different origin, to hold solvers of conic programs against each other.

Every origin yields named programs whose moments lie in [-1, 1] (``EMPTY`` ones have none).
All numbers are drawn with fixed seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling

from . import identification, networks

__all__ = ["NAMED", "ORIGINS", "Case", "cases", "on_the_box", "path", "record", "star", "tree"]


@dataclass(frozen=True)
class Case:
    """A program by name, built when asked for."""

    origin: str
    name: str
    build: Callable[[], ConicProgram]


def on_the_box(objective: sp.Polynomial, order: int, rows: list | None = None, **options):
    """A relaxation on [-1, 1]^n."""
    problem = sp.Problem(objective, rows or [], lower=-1, upper=1)
    return sp.assemble(sp.relax(problem, order, **options), objective)


# ---- structures ------------------------------------------------------------------------------


def path(size: int, count: int) -> ConicProgram:
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
    return on_the_box(sp.total(parts), 2)


def tree(n: int, order: int = 3, seed: int | None = None) -> ConicProgram:
    """Quartic terms along the edges of a random tree."""
    rng = np.random.default_rng(n if seed is None else seed)
    x = sp.variables(n)
    parts = [float(rng.normal()) * v for v in x]
    for i in range(1, n):
        j = int(rng.integers(0, i))
        parts += [(x[i] - float(rng.normal()) * x[j] ** 2) ** 2, float(rng.normal()) * x[i] * x[j]]
    return on_the_box(sp.total(parts), order)


def record(samples: int, order: int, *, parameters: int = 5, seed: int = 0, **options: bool):
    """y_k + a1 y_{k-1} + a2 y_{k-2} = b0 u_k + b1 u_{k-1} + b2 u_{k-2}, y = eta + noise."""
    rng = np.random.default_rng(seed)
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
    return on_the_box(x[0], order, rows, **options)


def star(
    kind: str, samples: int, shape: str, end: int, noise: float = 1.0, seed: int = 0
) -> ConicProgram:
    """One of the ten bounds of a record, in the shapes between order 1 and order 2."""
    relaxation, objectives = _shaped(kind, samples, shape, noise, seed)
    return sp.assemble(relaxation, objectives[end])


@cache
def _shaped(
    kind: str, samples: int, shape: str, noise: float, seed: int
) -> tuple[Relaxation, tuple[sp.Polynomial, ...]]:
    task = identification.task(kind, samples, noise, seed)
    box = Interval(task.problem.lower, task.problem.upper)
    scaled = Scaled.of(task.problem, Scaling.of_box(box), task.objectives)
    relaxation = sp.relax(scaled.problem, shape=shape, products=True, objectives=scaled.objectives)
    return relaxation, tuple(scaled.objectives)


# ---- the set ---------------------------------------------------------------------------------


def _chains() -> Iterator[Case]:
    for make in (
        sp.problems.rosenbrock,
        sp.problems.chained_wood,
        sp.problems.broyden_tridiagonal,
        sp.problems.chained_singular,
    ):
        for n in (8, 20, 40, 80, 160):
            build = partial(lambda make, n: on_the_box(make(n).objective, 2), make, n)
            yield Case("chains", f"{make.__name__} {n}", build)
        for n in (8, 12):
            build = partial(lambda make, n: on_the_box(make(n).objective, 2, lean=True), make, n)
            yield Case("chains", f"{make.__name__} {n}, lean", build)
    for n in (4, 8, 16):
        build = partial(lambda n: on_the_box(sp.problems.rosenbrock(n).objective, 3), n)
        yield Case("chains", f"rosenbrock {n}, order 3", build)


def _trees() -> Iterator[Case]:
    for seed in range(24):
        n = 6 + 2 * seed
        yield Case("trees", f"tree of {n}", partial(tree, n, 2, seed))
    for seed in range(8):
        n = 4 + 2 * seed
        yield Case("trees", f"tree of {n}, order 3", partial(tree, n, 3, seed))


def _random(seed: int, order: int) -> ConicProgram:
    """Terms on random subsets of variables, some rows on others; the origin fits all of them."""
    rng = np.random.default_rng(seed)
    n, degree = int(rng.integers(5, (13, 9, 6)[order - 1])), min(2 * order, 4)
    x = sp.variables(n)
    few = (1, 2) if order == 1 else (2, 3)

    def some() -> list[sp.Polynomial]:
        return [x[int(i)] for i in rng.choice(n, int(rng.choice(few)) + 1, replace=False)]

    def form(terms: list[sp.Polynomial]) -> sp.Polynomial:
        return sp.total([float(rng.normal()) * v for v in terms])

    parts = [float(rng.normal()) * v for v in x]
    parts += [form(some()) ** int(rng.integers(1, degree + 1)) for _ in range(n)]
    rows: list = []
    if seed % 3 == 1:
        rows += [form(some()) ** 2 <= float(rng.uniform(0.2, 1)) for _ in range(n // 2)]
    if seed % 3 == 2:
        for _ in range(n // 3):
            v = some()
            rows.append(form(v[:2]) * v[0] + 0.5 * v[1] == 0)
    return on_the_box(sp.total(parts), order, rows, products=seed % 2 == 0 and order == 1)


def _sparse() -> Iterator[Case]:
    for order, count in ((1, 56), (2, 54), (3, 5)):
        for seed in range(count):
            yield Case("random sparse", f"{seed}, order {order}", partial(_random, seed, order))


def _identification() -> Iterator[Case]:
    for kind in ("oe", "eiv"):
        for samples in (12, 20, 40):
            for shape in ("star", "split"):
                for end in range(10):
                    build = partial(star, kind, samples, shape, end)
                    yield Case("identification", f"{kind} {samples} {shape} {end}", build)
        for end in (0, 3, 9):
            build = partial(star, kind, 20, "star", end, 5.0, 1)
            yield Case("identification", f"{kind} 20 star {end}, noise x5", build)
    for seed in range(4):
        for samples in (10, 30):
            build = partial(record, samples, 2, parameters=2, seed=seed)
            yield Case("identification", f"first order {samples} {seed}, order 2", build)
            for order in (1, 2):
                build = partial(record, samples, order, lean=True, products=True, seed=seed)
                name = f"second order {samples} {seed}, lean {order}"
                yield Case("identification", name, build)
    yield Case("identification", "second order 10, order 2", partial(record, 10, 2))


def _pooling() -> Iterator[Case]:
    for price in (16.0, 13.0, 10.0):
        for cap in (100.0, 300.0, 600.0):
            for order in (1, 2):
                yield Case("pooling", f"{price} {cap}, {order}", partial(_pool, price, cap, order))


def _pool(price: float, cap: float, order: int) -> ConicProgram:
    problem = networks.haverly(price, cap, 0.0).problem
    lower = np.where(np.isfinite(problem.lower), problem.lower, 0.0)
    upper = np.where(np.isfinite(problem.upper), problem.upper, 600.0)
    scaled = Scaled.of(problem, Scaling.of_box(Interval(lower, upper)), (problem.objective,))
    relaxation = sp.relax(scaled.problem, order, products=order == 1, objectives=scaled.objectives)
    return sp.assemble(relaxation, scaled.objectives[0])


def _blocks() -> Iterator[Case]:
    for size, count in ((3, 1), (3, 8), (4, 4), (4, 16), (5, 4), (6, 3), (7, 2), (8, 1)):
        yield Case("blocks", f"{count} cliques of {size}", partial(path, size, count))
    for n in range(1, 12):
        yield Case("blocks", f"dense quartic in {n}", partial(_dense, n))
    for n in (2, 5, 10, 20, 40, 60, 79):
        for seed in range(2):
            yield Case("blocks", f"cut of {n} {seed}", partial(_cut, n, seed))


def _dense(n: int) -> ConicProgram:
    rng = np.random.default_rng(n)
    x = sp.variables(n)
    forms = [sp.total([float(rng.normal()) * v for v in x]) for _ in range(3)]
    f = sp.total([(g**2 - 0.5) ** 2 for g in forms] + [float(rng.normal()) * v for v in x])
    return on_the_box(f * (1.0 / n), 2)


def _cut(n: int, seed: int) -> ConicProgram:
    """Maximum cut of a random graph: one dense block of n + 1 with a fixed diagonal."""
    rng = np.random.default_rng(seed)
    x = sp.variables(n)
    edges = [(i, j) for i in range(n) for j in range(i) if rng.uniform() < 0.5 or j == i - 1]
    f = sp.total([0.5 * x[i] * x[j] for i, j in edges] + [0.1 * x[0]])
    return on_the_box(f, 1, [v**2 == 1 for v in x])


def _badly_scaled() -> Iterator[Case]:
    others = [*_chains()][:21:3] + [*_trees()][:12:2] + [*_sparse()][:96:8] + [*_blocks()][:16:3]
    for number, case in enumerate(others):
        for factor in (1e-4, 1e5):
            yield Case(
                "badly scaled",
                f"{case.name} x {factor:g}",
                partial(_spoilt, case, number, factor),
            )


def _spoilt(case: Case, seed: int, factor: float) -> ConicProgram:
    """Every row and block times a power of ten, the objective times a factor."""
    program = case.build()
    rng = np.random.default_rng(seed)
    cones = program.cones
    sizes = [1] * (cones.zero + cones.nonnegative) + [s * (s + 1) // 2 for s in cones.psd]
    scale = np.repeat(10.0 ** rng.uniform(-3, 3, len(sizes)), sizes)
    rows = sps.csc_array(sps.diags_array(scale) @ program.A)
    offset = program.offset * factor
    return replace(program, q=program.q * factor, A=rows, b=program.b * scale, offset=offset)


def _equalities() -> Iterator[Case]:
    for seed in range(8):
        for kind in ("binary", "spheres", "products"):
            for reduce in (True, False):
                name = f"{kind} {seed}" + ("" if reduce else ", not reduced")
                yield Case("equality-rich", name, partial(_equal, kind, seed, reduce))


def _equal(kind: str, seed: int, reduce: bool) -> ConicProgram:
    rng = np.random.default_rng(seed)
    n = 6 + seed
    x = sp.variables(n)
    f = sp.total([float(rng.normal()) * x[i] * x[i + 1] for i in range(n - 1)] + [0.3 * x[0]])
    if kind == "binary":
        rows = [v**2 == 1 for v in x]
    elif kind == "spheres":
        rows = [x[i] ** 2 + x[i + 1] ** 2 == 1 for i in range(n - 1)]
    else:
        rows = [x[i + 1] == float(rng.uniform(0.2, 0.9)) * x[i] ** 2 for i in range(n - 1)]
    return on_the_box(f, 2, rows, reduce=reduce)


def _degenerate() -> Iterator[Case]:
    x = sp.variables(4)
    squares = {
        "square": ((x[0] - x[1]) ** 2, []),
        "fourth power": ((x[0] - x[1] + x[2]) ** 4, []),
        "flat": (0.0 * x[0] * x[1], []),
        "many minimisers": ((x[0] ** 2 - 0.25) ** 2 + (x[1] * x[2]) ** 2, []),
        "linear": (x[0] + x[1] + x[2] + x[3], []),
        "point": (x[0] * x[1] - x[2], [x[0] == 0.5, x[1] == 0.25]),
        "line": (x[0] * x[1], [x[0] + x[1] == 2]),
        "no interior": (x[0] - x[1], [x[0] ** 2 + x[1] ** 2 <= 0]),
        "twice the same": (x[0] * x[1], [x[0] + x[1] == 0.5, 2 * x[0] + 2 * x[1] == 1]),
        "tangent": (x[0] - x[1], [(x[0] - 1) ** 2 + x[1] ** 2 <= 1, x[0] <= 0]),
    }
    for name, (f, rows) in squares.items():
        for order in (1, 2, 3):
            build = partial(on_the_box, f, max(order, (f.degree + 1) // 2), rows)
            yield Case("degenerate", f"{name}, order {order}", build)


def _empty() -> Iterator[Case]:
    for seed in range(8):
        for kind in ("far", "product", "sphere"):
            yield Case("empty", f"{kind} {seed}", partial(_without_points, kind, seed))


def _without_points(kind: str, seed: int) -> ConicProgram:
    """Rows on the box that no moments satisfy at order 2."""
    rng = np.random.default_rng(seed)
    n = 3 + seed
    x = sp.variables(n)
    f = sp.total([float(rng.normal()) * x[i] * x[i + 1] for i in range(n - 1)])
    rows = {
        "far": [x[0] + x[1] >= 2.5],
        "product": [x[0] * x[n - 1] == 1.5],
        "sphere": [x[0] ** 2 + x[1] ** 2 == 0.5, x[0] + x[1] >= 1.1],
    }[kind]
    rows = rows + [x[i] * x[i + 1] <= 0.5 for i in range(n - 1)]
    return on_the_box(f, 2, rows)


ORIGINS: dict[str, Callable[[], Iterator[Case]]] = {
    "chains": _chains,
    "identification": _identification,
    "trees": _trees,
    "random sparse": _sparse,
    "pooling": _pooling,
    "badly scaled": _badly_scaled,
    "equality-rich": _equalities,
    "degenerate": _degenerate,
    "empty": _empty,
    "blocks": _blocks,  # the last, as Clarabel takes minutes for the largest
}
NAMED = ("chains", "identification")  # at most 2 % of these may need the fallback


def cases(origins: list[str] | None = None) -> list[Case]:
    """All programs of the given origins."""
    return [case for origin in origins or ORIGINS for case in ORIGINS[origin]()]
