"""Who may import whom within setid: modules import from their left, doors for third parties.

That setid uses public names of the engine alone is in ``tests/test_imports.py``.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import setid

ROOT = Path(setid.__file__).resolve().parent

ORDER = """
errors checks reading data record_plots
models models.equations models.products models.lti models.maps models.wiring models.declared
models.general models.block models.continuous models.narx
layout noise signals compiler regression smoothing interval_arithmetic monomials
priors priors.base priors.stability priors.hurwitz priors.coefficients priors.transfer
priors.normalisation
missing printing assembly linear completion formulation units
estimators simulate equivalence responses supports enclosures members bands exchange indirect
projections
residuals block_bands validation
options bounds attained boxes directions far lifted cell_structure cell_arithmetic cells
boxed reports existence starts idle noise_factor common_factor unnormalised verification
centre intervals progress driving discretisation search results identify consistency select
plots block_plots cli_structure cli
""".split()

DOORS = {"matplotlib": {"record_plots"}, "control": {"exchange"}}
SCIPY_DOORS = {"scipy.io": {"reading"}, "scipy.optimize": {"linear"}}
ANYWHERE = {"numpy", "scipy", "sparsepop_py"}
# imported inside functions, by the one line of ``.plot()``
DELEGATED = {"record_plots", "plots", "block_plots"}


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


TREES = {name_of(path): ast.parse(path.read_text()) for path in sorted(ROOT.rglob("*.py"))}


def runtime_imports(module: str) -> list[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Import statements that run, and whether they stand inside a function."""

    def walk(node: ast.AST, inside: bool):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            if isinstance(child, ast.Import | ast.ImportFrom):
                yield child, inside
            yield from walk(child, inside or isinstance(child, ast.FunctionDef))

    return list(walk(TREES[module], False))


def reached(module: str, node: ast.Import | ast.ImportFrom) -> set[str]:
    """Modules of setid that a statement imports; its own ``__init__`` is ``""``."""
    if isinstance(node, ast.Import) or not node.level:
        return set()
    package = (ROOT / Path(*module.split("."))).is_dir() if module else True
    parents = module.split(".") if module else []
    up = node.level - (1 if package else 0)
    base = ".".join([*parents[: len(parents) - up], *((node.module or "").split("."))]).strip(".")
    inner = {f"{base}.{alias.name}".strip(".") for alias in node.names}
    return {name for name in inner if name in TREES} or {base}


def test_the_order_lists_every_module_once() -> None:
    assert sorted(ORDER) == sorted(name for name in TREES if name), "keep ORDER complete"


def rank(module: str) -> int:
    """A package stands after its modules: its ``__init__`` gathers them."""
    inside = [place for place, name in enumerate(ORDER) if name.split(".")[0] == module]
    return max(inside)


@pytest.mark.parametrize("module", [name for name in TREES if name])
def test_modules_import_only_from_their_left(module: str) -> None:
    here = rank(module) if module in {n.split(".")[0] for n in ORDER} else ORDER.index(module)
    for node, inside in runtime_imports(module):
        for other in reached(module, node):
            if inside:
                assert other in DELEGATED, f"{module} imports {other} inside a function"
            else:
                assert ORDER.index(other) <= here and other != module, f"{module}: {other}"


@pytest.mark.parametrize("module", list(TREES))
def test_third_parties_have_one_door(module: str) -> None:
    for node, inside in runtime_imports(module):
        if isinstance(node, ast.ImportFrom) and node.level:
            continue
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module]
        for name in names:
            top = str(name).split(".")[0]
            if top in sys.stdlib_module_names:
                continue
            assert top in ANYWHERE or module in DOORS.get(top, ()), f"{module} imports {name}"
            assert module in SCIPY_DOORS.get(str(name), {module}), f"{module} imports {name}"
            assert not inside or top in DOORS, f"{module} imports {name} inside a function"


def test_no_file_is_long() -> None:
    for path in [*ROOT.rglob("*.py"), *Path(__file__).parent.glob("*.py")]:
        assert len(path.read_text().splitlines()) <= 400, path
