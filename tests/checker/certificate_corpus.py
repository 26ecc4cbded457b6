"""Problems of all kinds and what the package proves of them, as files for the second checker.

``python tests/checker/certificate_corpus.py folder [group ...]`` solves them and writes
``group-name.json``, one result a file. Only the public face of the package is used.
"""

from __future__ import annotations

import functools
import json
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "helpers"), str(HERE.parent.parent)]

import known_certificates  # noqa: E402
import random_cases  # noqa: E402
import random_matrices  # noqa: E402

import sparsepop_py as sp  # noqa: E402
from sparsepop_py import Switches, problems  # noqa: E402

INF = float("inf")
ZOO = HERE.parent / "problems" / "zoo"
Solved = Iterator[tuple[str, sp.Result]]


def known() -> Solved:
    """The problems that the package's own tests damage certificates of."""
    for make, result in known_certificates.known_results().items():
        yield make.__name__, result


def known_auto() -> Solved:
    """The same problems with the ladder."""
    for make in known_certificates.KNOWN:
        yield make.__name__, sp.solve(make(), sp.Options(effort="auto", time_limit=10))


def zoo(effort: str = "presolve", every: int = 1) -> Solved:
    """Problems with known optima, at their orders or with the ladder."""
    entries = [
        entry
        for path in sorted(ZOO.glob("*.toml"))
        for entry in tomllib.loads(path.read_text())["problem"]
    ]
    for entry in entries[::every]:
        problem = sp.parse(entry["text"])
        if effort == "auto":
            yield f"{entry['name']}-auto", sp.solve(problem, options(effort))
            continue
        for order in entry["orders"]:
            if order not in entry.get("slow", ()) and problem.dimension ** (2 * order) < 3e5:
                yield f"{entry['name']}-{order}", sp.solve(problem, options(effort, order=order))


def options(effort: str, **more: object) -> sp.Options:
    """Options with a limit of time where it is needed."""
    return sp.Options(effort=effort, time_limit=6 if effort == "auto" else None, **more)


def random(count: int = 60) -> Solved:
    """Random problems with a planted point."""
    for seed in range(count):
        effort = ("presolve", "auto", "plain")[seed % 3]
        yield f"{seed}-{effort}", sp.solve(random_cases.random_case(seed).problem, options(effort))


def trees(count: int = 40) -> Solved:
    """Random problems by linear relaxations and branch and bound alone."""
    skip = ("star", "split", "mixed", "full", "monomials", "partners", "chordal", "components")
    for seed in range(count):
        problem = random_cases.random_case(1000 + seed).problem
        more = {"skip": skip, "node_limit": 60, "gap": 1e-4}
        yield str(seed), sp.solve(problem, options("auto", **more))


def matrices(count: int = 40) -> Solved:
    """Random problems with matrices and second-order cones."""
    for seed in range(count):
        effort = ("presolve", "auto")[seed % 2]
        yield str(seed), sp.solve(random_matrices.random_problem(seed), options(effort))


def examples() -> Solved:
    """The problems of the examples."""
    for path in sorted((HERE.parent.parent / "examples" / "problems").glob("*.gms")):
        for effort in ("presolve", "auto"):
            yield f"{path.stem}-{effort}", sp.solve(sp.read_gms(path), options(effort))


CHAINS = ("rosenbrock", "chained_wood", "chained_singular", "nondquar", "broyden_tridiagonal")


def chains() -> Solved:
    """Sums of squares without a box: exact Gram matrices, floors, squares."""
    for name in CHAINS:
        for size in (4, 8, 12, 20):
            given = getattr(problems, name)(size)
            yield f"{name}-{size}-expanded", sp.solve(sp.Problem(given.objective))
            yield f"{name}-{size}", sp.solve(given)


def coercive(count: int = 16) -> Solved:
    """Problems without bounds that sublevel sets give a box."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        x = sp.variables(int(rng.integers(1, 4)))
        f = sp.total([v**4 for v in x]) + random_cases.some_polynomial(rng, x, 3)
        rows = [] if seed % 3 == 0 else [x[0] + x[-1] <= 10]
        rows += [x[0] * x[-1] >= -4] if seed % 3 == 2 else []
        yield str(seed), sp.solve(sp.Problem(f, rows), options("presolve", order=2))


def inverses(count: int = 16) -> Solved:
    """Linear equations with errors in their coefficients and unbounded solutions."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        size, rows = int(rng.integers(1, 3)), int(rng.integers(3, 7))
        truth, clean = rng.uniform(-3, 3, size), rng.uniform(-2, 2, (rows, size))
        noise = rng.uniform(-0.05, 0.05, (rows, size))
        x = sp.variables(size + rows * size)
        theta, errors = x[:size], np.array(x[size:]).reshape(rows, size)
        equations = []
        for k in range(rows):
            terms = [
                (float(clean[k, j] - noise[k, j]) + errors[k, j]) * theta[j] for j in range(size)
            ]
            equations.append(sp.total(terms) == float(clean[k] @ truth))
        low = np.append(np.full(size, -INF), np.full(rows * size, -0.05))
        problem = sp.Problem(theta[0], equations, low, -low)
        yield str(seed), sp.solve(problem, options("auto"))


def families() -> Solved:
    """Several objectives over one set: quoted certificates, tightening."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        u, truth = rng.choice([-1.0, 1.0], 8), (-0.7, 1.0)
        y = np.zeros(8)
        for k in range(1, 8):
            y[k] = -truth[0] * y[k - 1] + truth[1] * u[k]
        y += rng.uniform(-0.1, 0.1, 8)
        x = sp.variables(10)
        a, b, e = x[0], x[1], x[2:]
        rows = [
            (float(y[k]) - e[k]) + a * (float(y[k - 1]) - e[k - 1]) - b * float(u[k]) == 0
            for k in range(1, 8)
        ]
        low, high = [-1.5, -3.0] + [-0.1] * 8, [0.0, 3.0] + [0.1] * 8
        asked = [a, -a, b, -b]
        found = sp.solve_each(sp.Problem(a, rows, low, high), asked, options("auto", gap=1e-5))
        for place, result in enumerate(found):
            yield f"{seed}-{place}", result


def empty(count: int = 16) -> Solved:
    """Problems without feasible points: what a random problem attains nowhere."""
    for seed in range(count):
        case = random_cases.random_case(500 + seed)
        problem = case.problem
        rows = [*problem.constraints, problem.objective <= case.least - 5.0]
        made = sp.Problem(problem.objective, rows, problem.lower, problem.upper)
        yield str(seed), sp.solve(made, options("auto"))


UNBOUNDED = (
    "min x",
    "min -x^2",
    "min x^3",
    "min x1+x2; s.t. x1-x2==0",
    "min -x1*x2; s.t. x1>=0; x2>=1",
    "min -x1; s.t. x1*x2>=1; x2-0.5>=0",
    "min x1*x2; s.t. x1>=1",
    "min -x1-x2^3; s.t. x1+x2>=7; x2>=0; x1>=0",
)


def unbounded() -> Solved:
    """Rays along which the objective falls."""
    for place, text in enumerate(UNBOUNDED):
        yield str(place), sp.solve(sp.parse(text))
    x, y = sp.variables(2)
    yield "cone", sp.solve(sp.Problem(-x, [sp.second_order(x, y)]))
    yield "matrix", sp.solve(sp.Problem(-x - y, [sp.psd([[x, 1.0], [1.0, y]])]))


def switches(every: int = 2) -> Solved:
    """SparsePOP's relaxation: prices of moments, scaling without a shift."""
    for path in sorted(ZOO.glob("*.toml")):
        for entry in tomllib.loads(path.read_text())["problem"][::every]:
            problem = sp.parse(entry["text"])
            order = entry["orders"][0]
            if problem.dimension ** (2 * order) > 3e5:
                continue
            chosen = Switches(order=order, moment_bounds=1)
            yield entry["name"], sp.solve(problem, sp.Options(effort="plain", switches=chosen))
    for seed in range(16):
        problem = random_cases.random_case(2000 + seed).problem
        chosen = Switches(moment_bounds=1 + seed % 2, scaled=bool(seed % 4))
        yield f"random-{seed}", sp.solve(problem, sp.Options(effort="plain", switches=chosen))


def deep() -> Solved:
    """Larger trees: pooling and random problems in four variables, by linear relaxations."""
    pooling = sp.read_gms(HERE.parent.parent / "examples" / "problems" / "pooling.gms")
    skip = ("star", "split", "mixed", "full", "monomials", "partners", "chordal", "components")
    more = {"skip": skip, "node_limit": 400, "gap": 1e-5}
    yield "pooling", sp.solve(pooling, sp.Options(effort="auto", time_limit=20, **more))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        x = sp.variables(4)
        f = random_cases.some_polynomial(rng, x, 4) + random_cases.some_polynomial(rng, x, 3)
        rows = [random_cases.some_polynomial(rng, x, 2) + 1.0 >= 0]
        problem = sp.Problem(f, rows, -1, 1)
        yield str(seed), sp.solve(problem, sp.Options(effort="auto", time_limit=20, **more))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        x = sp.variables(7)
        q = rng.integers(-8, 9, (7, 7)) / 4.0
        f = sp.total([float(q[i, j]) * x[i] * x[j] for i in range(7) for j in range(i + 1)])
        problem = sp.Problem(f, [sp.total(x) <= 2, x[0] * x[1] >= 0.1], -1, 1)
        yield f"dense-{seed}", sp.solve(problem, sp.Options(effort="auto", time_limit=30, **more))


def polyhedra(count: int = 30) -> Solved:
    """Linear and convex quadratic objectives over unbounded polyhedra."""
    for seed in range(count):
        problem, _ = random_cases.over_a_polyhedron(seed)
        yield str(seed), sp.solve(problem, options("presolve"))
    x = sp.variables(2)
    yield "empty", sp.solve(sp.Problem(x[0], [x[0] + x[1] >= 1, x[0] + x[1] <= 0]))


GROUPS: dict[str, Callable[[], Solved]] = {
    "known": known,
    "known_auto": known_auto,
    "zoo": zoo,
    "zoo_auto": lambda: zoo("auto"),
    "random": random,
    "trees": trees,
    "matrices": matrices,
    "examples": examples,
    "chains": chains,
    "coercive": coercive,
    "inverses": inverses,
    "families": families,
    "empty": empty,
    "unbounded": unbounded,
    "switches": switches,
    "deep": deep,
    "polyhedra": polyhedra,
}


def kinds(result: dict) -> set[str]:
    """What a result in JSON rests on."""
    found = set()
    if result["attained"] is not None:
        found.add(f"attained {result['attained']['proof']}")
    if result["status"] == "UNBOUNDED":
        found.add("ray")
    certificates = result["certificate"] or []
    if certificates and certificates[-1]["bound"] == "inf":
        found.add("no feasible point")
    for part in (part for c in certificates for part in c["parts"]):
        found |= {step["is"] for step in part["steps"]} | ({"tree"} if part["children"] else set())
        given = [s.get("argument") or s.get("identity") for s in part["steps"]]
        for argument in filter(None, [part["argument"], *given]):
            found |= traits(argument)
    return found


def traits(argument: dict) -> set[str]:
    """What an identity, linear dual or Gram matrix makes use of."""
    groups = argument.get("multipliers", ())
    scaling = argument.get("scaling") or {"ends": None}
    holds = {
        argument.get("is", "Identity"): True,
        "floor": any(group["floor"] for group in groups),
        "matrix multiplier": any(group["place"] for group in groups),
        "priced": argument.get("priced"),
        "products": argument.get("products", {}).get("data"),
        "ends of t": scaling["ends"],
    }
    return {name for name, value in holds.items() if value}


# what fast tests look at: how many of a group
FEW = {"known": 6, "random": 9, "trees": 8, "matrices": 6, "coercive": 4, "inverses": 4}
FEW |= {"polyhedra": 10}
FEW |= {"empty": 4, "families": 4, "switches": 4, "unbounded": 2, "examples": 99, "chains": 6}
FEW |= {"zoo": 16}


@functools.cache
def solved(group: str, most: int) -> dict[str, str]:
    """The first results of a group, as JSON."""
    found = {}
    for name, value in GROUPS[group]():
        found[name] = sp.to_json(value)
        if len(found) == most:
            break
    return found


def write(folder: Path, groups: list[str]) -> None:
    """Solve the groups and write their results."""
    folder.mkdir(parents=True, exist_ok=True)
    for group in groups:
        begin, count = time.time(), 0
        for name, result in GROUPS[group]():
            text = sp.to_json(result)
            (folder / f"{group}-{name}.json").write_text(text)
            count += 1
            json.loads(text)
        print(f"{group}: {count} results, {time.time() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    write(Path(sys.argv[1]), sys.argv[2:] or list(GROUPS))
