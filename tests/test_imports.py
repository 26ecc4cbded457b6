"""Who may import whom: modules import from their left, third parties have one door each."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import sparsepop_py as sp

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "sparsepop_py"

# A module imports only from those before it. A package is named by its folder alone.
ORDER = """
errors threads constraint progress display interned monomials rounding polynomial system cones
squares symbolic problem enclosure semidefinite linear krawczyk rational feasibility generators
presolve presolve.propagation presolve.scaling
chordal sparsity basis newton blocks shapes signs terms relaxation substitution moment_bounds
elimination waki conic
solvers.base solvers.clarabel_ solvers.cvxpy_
solvers.cliquetree.elimination solvers.cliquetree.kernels solvers.cliquetree.tree
solvers.cliquetree.machine solvers.cliquetree.compiled_lanczos
solvers.cliquetree.compiled_blocks solvers.cliquetree.compiled_lanes
solvers.cliquetree.compiled_pairs
solvers.cliquetree.compiled solvers.cliquetree.fronts solvers.cliquetree.layout
solvers.cliquetree.assembly solvers.cliquetree.symbolic solvers.cliquetree.cone
solvers.cliquetree.numbers
solvers.cliquetree.progress solvers.cliquetree.repair solvers.cliquetree.interior
solvers.cliquetree.second_order solvers.cliquetree solvers condense
certificate certificate.multipliers certificate.priced certificate.identity certificate.gram
certificate.linear
certificate.inverse certificate.rows certificate.box
certificate.certificate certificate.dual
extraction sequential rowform descent refinement multistart unbounded options task catalogue sizing
boxes incumbents
result polyhedron exact_simplex polytope rungs recovery free lifting narrowing squeezing
parts branch
ground agenda auto ladder family solve
formats formats.expressions formats.text formats.gms_statements formats.gms_writer formats.gms
structs
problems.least_squares problems.chains problems.control problems.planted problems.classics
problems plots
formats.json_codecs formats.json_certificates formats.json_ formats.sdpa
parameter_table parameter_values parameters error_bounds sedumi sparsepop_input sparsepop_output
sparsepop_structs formats.mat sparsepop_sizes sparsepop_report sparsepop_files sparsepop door cli
""".split()

DOORS = {
    "clarabel": "solvers.clarabel_",
    "cvxpy": "solvers.cvxpy_",
    "highspy": "linear",
    "sympy": "symbolic",
    "networkx": "chordal",
    "matplotlib": "plots",
    "casadi": "refinement",
    "threadpoolctl": "threads",
    "numba": "solvers.cliquetree.machine",
    "llvmlite": "solvers.cliquetree.machine",
}
EVERYWHERE = {"numpy", "scipy"}
LINEAR_PROGRAMS = {"linprog", "milp", "linprog_verbose_callback"}
OPTIONAL = {"sympy", "cvxpy", "casadi", "matplotlib"}  # may be imported inside functions
DELEGATED = {"plots"}  # ... and so may this module, by the one line of ``.plot()``
MOST_LINES = 400


@dataclass(frozen=True)
class Import:
    """One import statement's target, as a dotted name and the names taken from it."""

    target: str
    names: tuple[str, ...]
    inside: bool  # a function


def modules(package: str) -> dict[str, ast.Module]:
    """Parsed modules by dotted name below the package; its own ``__init__`` is ``""``."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT / package).with_suffix("").parts
        found[".".join(p for p in parts if p != "__init__")] = ast.parse(path.read_text())
    return found


def is_package(package: str, module: str) -> bool:
    return (ROOT / package / Path(*module.split(".")) / "__init__.py").exists()


def imports(package: str, module: str, tree: ast.AST, inside: bool = False) -> Iterator[Import]:
    """All imports but those for type checkers, relative ones resolved to absolute names."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, (), inside)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = [package, *(module.split(".") if module else [])]
                up = node.level - (1 if is_package(package, module) else 0)
                parents = parents[: len(parents) - up]
                base = ".".join([*parents, *([base] if base else [])])
            yield Import(base, tuple(alias.name for alias in node.names), inside)
        else:
            function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from imports(package, module, node, inside or function)


TREES = modules(PACKAGE)


def internal(found: Import) -> set[str]:
    """Modules of this package that an import reaches."""
    if found.target == PACKAGE:
        return {name if name in TREES else "" for name in found.names} or {""}
    if not found.target.startswith(PACKAGE + "."):
        return set()
    base = found.target.removeprefix(PACKAGE + ".")
    inner = {f"{base}.{name}" for name in found.names if f"{base}.{name}" in TREES}
    return inner if inner and len(inner) == len(found.names) else {base, *inner}


def test_the_order_lists_every_module_once() -> None:
    assert sorted(ORDER) == sorted(name for name in TREES if name), "keep ORDER complete"


@pytest.mark.parametrize("module", [name for name in TREES if name])
def test_modules_import_only_from_their_left(module: str) -> None:
    allowed = set(ORDER[: ORDER.index(module)])
    for found in imports(PACKAGE, module, TREES[module]):
        reached = internal(found)
        if found.inside:
            assert reached <= DELEGATED, f"{module} imports {reached} inside a function"
        else:
            assert reached <= allowed, f"{module} imports {reached - allowed}, which is not left"


@pytest.mark.parametrize("module", list(TREES))
def test_third_parties_have_one_door(module: str) -> None:
    for found in imports(PACKAGE, module, TREES[module]):
        top = found.target.split(".")[0]
        if top == PACKAGE or top in sys.stdlib_module_names:
            assert not found.inside or top == PACKAGE, f"{module} imports {top} inside a function"
            continue
        assert top in EVERYWHERE or DOORS.get(top) == module, f"{module} imports {top}"
        assert not found.inside or top in OPTIONAL, f"{module} imports {top} inside a function"
        if found.target == "scipy.optimize":
            linear = LINEAR_PROGRAMS.intersection(found.names)
            assert not linear or module == "linear", f"{module} imports {linear}"


def test_setid_uses_public_names_only() -> None:
    for module, tree in modules("setid").items():
        for found in imports("setid", module, tree):
            assert not found.target.startswith(PACKAGE + "."), f"setid.{module}: {found}"
            if found.target == PACKAGE:
                assert set(found.names) <= set(sp.__all__), f"setid.{module}: {found}"
        aliases = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.Import)
            for alias in node.names
            if alias.name == PACKAGE
        }
        used = {
            node.attr
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in aliases
        }
        assert used <= set(sp.__all__), f"setid.{module} uses {used - set(sp.__all__)}"


def test_the_engine_never_imports_setid() -> None:
    for module, tree in TREES.items():
        for found in imports(PACKAGE, module, tree):
            assert found.target.split(".")[0] != "setid", module


def test_only_the_command_line_prints() -> None:
    for package in (PACKAGE, "setid"):
        for module, tree in modules(package).items():
            calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
            printing = [c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "print"]
            assert not printing or module == "cli", f"{package}.{module} prints"


def test_no_file_is_long() -> None:
    folders = (PACKAGE, "setid", "tests", "examples", "benchmarks")
    lines = {
        str(path.relative_to(ROOT)): len(path.read_text().splitlines())
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
    }
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}
