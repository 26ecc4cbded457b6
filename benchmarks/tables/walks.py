"""Measure how the code is laid out: folders, imports, traced walks, words and docstrings.

``python -m benchmarks walks`` prints one Markdown table about the checkout it lies in. It
names public functions and types only, so it measures any layout of the two packages. Counts
of files depend on the instance that is traced, CPU times on the machine; the rest is exact.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import networkx as nx

import setid
import sparsepop_py as sp

from .text import table

__all__ = ["Trace", "floors", "import_graph", "trace", "walks"]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("sparsepop_py", "setid")
# folders whose defects could make a false claim; those that are not there are left out
TRUSTED = (
    *("sparsepop_py/verified", "sparsepop_py/algebra", "sparsepop_py/problem"),
    *("setid/proofs", "setid/data", "setid/formulation"),
)
FIELD_WORDS = ("incumbent", "OBBT", "FBBT", "cutoff", "node", "branch", "hierarchy")
PRIVATE_WORDS = (
    *("rung", "climb", "ladder", "agenda", "ground", "squeez", "told", "endless"),
    *("interned", "rowform", "priced", "condense"),
)
_RIDDLE = re.compile(r"(What|How|Where|Whether|Which)\b")
_REPEATS = 7
_UNUSUAL = ("PYTHONDONTWRITEBYTECODE", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_IMPORTS = ("numpy, scipy.sparse", *PACKAGES)


def walks() -> str:
    """Measure everything and return a Markdown table of two columns."""
    rows = [*_folders(), *_import_rows(), *_traces(), *_words(), *_docstrings(), *_public()]
    return table(["measured", "found"], [*rows, *_seconds(), *_trusted()])


# ---- folders and imports ----------------------------------------------------------------


def _files(*folders: str) -> list[Path]:
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


def _lines(paths: list[Path]) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def _folders() -> Iterator[tuple[str, str]]:
    for package in PACKAGES:
        files = _files(package)
        counts = Counter(path.parent.relative_to(ROOT).as_posix() for path in files)
        largest = ", ".join(f"{name} {count}" for name, count in counts.most_common(3))
        yield f"modules at the top of `{package}`", str(counts[package])
        yield f"files a folder in `{package}`, the largest", f"{largest} ({len(counts)} folders)"
        yield f"lines of `{package}`", f"{_lines(files)} in {len(files)} files"


def import_graph(package: Path) -> nx.DiGraph:
    """Read who imports whom inside one package, lazy and typing imports included.

    Parameters
    ----------
    package : Path
        Its folder.

    Returns
    -------
    networkx.DiGraph
        An arrow from each module to each that it imports, by dotted names.
    """
    paths: dict[str, Path] = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph = nx.DiGraph()
    graph.add_nodes_from(paths)
    for name, path in paths.items():
        here = name if path.name == "__init__.py" else name.rpartition(".")[0]
        for target in _imported(ast.parse(path.read_text(encoding="utf-8")), here):
            module = target if target in paths else target.rpartition(".")[0]
            if module in paths and module != name:
                graph.add_edge(name, module)
    return graph


def _imported(tree: ast.AST, here: str) -> Iterator[str]:
    """Dotted names that a module of the folder ``here`` imports anywhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = here.split(".")
            start = above[: len(above) - node.level + 1] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def floors(graph: nx.DiGraph) -> tuple[int, int, int]:
    """Count the floors of a graph of imports: the arrows of its longest chain.

    Returns
    -------
    (floors, arrows, circle) : tuple of int
        Members of a circle share a floor; ``circle`` is the size of the largest, else 1.

    Examples
    --------
    >>> floors(nx.DiGraph([("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")]))
    (2, 4, 2)
    """
    above = nx.condensation(graph)
    circles = [len(above.nodes[each]["members"]) for each in above]
    longest = len(nx.dag_longest_path(above)) - 1
    return longest, graph.number_of_edges(), max(circles, default=1)


def _joined(graph: nx.DiGraph, place: Callable[[str], str]) -> nx.DiGraph:
    """The graph of groups of modules, which ``place`` names."""
    joined = nx.DiGraph()
    joined.add_nodes_from(place(name) for name in graph)
    joined.add_edges_from((place(a), place(b)) for a, b in graph.edges if place(a) != place(b))
    return joined


def _room(name: str) -> str:
    """The entry at the top of the package: a folder with all below it, or a module."""
    return ".".join(name.split(".")[:2])


def _folder(name: str) -> str:
    """The folder of a module for itself; modules at the top stand for themselves."""
    deep = name.count(".") > 1 and not (ROOT / name.replace(".", "/")).is_dir()
    return name.rpartition(".")[0] if deep else name


def _import_rows() -> Iterator[tuple[str, str]]:
    for package in PACKAGES:
        graph = import_graph(ROOT / package)
        rooms, folders = _joined(graph, _room), _joined(graph, _folder)
        for kind, each in (("modules", graph), ("rooms", rooms), ("folders", folders)):
            high, arrows, circle = floors(each)
            text = f"{high} floors, {arrows} arrows, largest circle {circle}"
            yield f"imports of `{package}` between {len(each)} {kind}", text


# ---- traces -----------------------------------------------------------------------------


@dataclass
class Trace:
    """Files of the two packages in the order of their first call, and how often they change.

    Parameters
    ----------
    files : list of str
        Paths below the root of the checkout.
    changes : int
        Calls whose file is another than that of the call before.

    Examples
    --------
    >>> str(Trace(["sparsepop_py/solve.py", "sparsepop_py/formats/text.py"], 1))
    '2 files in 2 folders, 1 changes of file'
    """

    files: list[str] = field(default_factory=list)
    changes: int = 0

    def __str__(self) -> str:
        folders = {name.rpartition("/")[0] for name in self.files}
        count = f"{len(self.files)} files in {len(folders)} folders"
        return f"{count}, {self.changes} changes of file"


class _Reached(BaseException):
    """The walk is over; no handler of errors should stop it."""


def trace(
    work: Callable[[], object],
    begin: Callable[[FrameType], bool] | None = None,
    end: Callable[[FrameType], bool] | None = None,
) -> Trace:
    """Record which files a call passes, in this thread.

    Comprehensions, lambdas and the bodies of modules are not counted as calls.

    Parameters
    ----------
    work : callable
    begin : callable, optional
        Recording begins when a frame for which this is true returns; at once by default.
    end : callable, optional
        The walk is broken off when a frame for which this is true is entered.

    Returns
    -------
    Trace
    """
    found, started, last = Trace(), begin is None, ""
    inside = tuple(str(ROOT / package) + os.sep for package in PACKAGES)

    def watch(frame: FrameType, event: str, _: object) -> None:
        nonlocal started, last
        if not started:
            started = event == "return" and begin is not None and begin(frame)
        elif event == "call":
            if end is not None and end(frame):
                sys.setprofile(None)
                raise _Reached
            name = frame.f_code.co_filename
            if name.startswith(inside) and not frame.f_code.co_name.startswith("<"):
                found.changes += last not in ("", name)
                short, last = Path(name).relative_to(ROOT).as_posix(), name
                found.files += [] if short in found.files else [short]

    with suppress(_Reached):
        sys.setprofile(watch)
        try:
            work()
        finally:
            sys.setprofile(None)
    return found


def _makes(kind: type) -> Callable[[FrameType], bool]:
    """Whether a frame is the constructor of a class."""
    return lambda frame: (
        frame.f_code.co_name == "__init__" and type(frame.f_locals.get("self")) is kind
    )


def _solver(frame: FrameType) -> bool:
    return frame.f_code.co_name == "solve_conic"


def _disc() -> tuple[Any, Any, Any, Any]:
    """The structs of the README: x1^4 - 3 x1 x2 + x2^2 on a disc, without bounds."""
    objective = {"supports": [[4, 0], [1, 1], [0, 2]], "coef": [1, -3, 1]}
    row = {"supports": [[0, 0], [2, 0], [0, 2]], "coef": [2, -1, -1]}
    head = {"typeCone": 1, "dimVar": 2, "noTerms": 3}
    return head | objective, [head | row], [-1e10, -1e10], [1e10, 1e10]


def _interval() -> tuple[float, float]:
    """A proved interval from 12 samples of y_k = 0.5 y_{k-1} + 2 u_k and a fixed error."""
    u = [0.8, -0.6, 0.3, 0.9, -0.7, 0.1, -0.9, 0.5, 0.6, -0.2, 0.4, -0.8]
    y, exact = [], 0.0
    for number, value in enumerate(u):
        exact = 0.5 * exact + 2.0 * value
        y.append(exact + 0.04 * (-1) ** (number // 2))
    data, model = setid.IOData(u=u, y=y), setid.TransferFunction(na=1, nb=1)
    outer = setid.identify(data, model, setid.Noise(output=0.05)).intervals["a1"].outer
    return float(outer[0]), float(outer[1])


def _load_all() -> None:
    """Import every module, so that no walk meets the bodies of modules."""
    for package in (sp, setid):
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not found.name.endswith("__main__"):
                with suppress(ImportError):  # software that is not installed
                    importlib.import_module(found.name)


def _traces() -> Iterator[tuple[str, str]]:
    _load_all()
    structs = (*_disc(), {"relaxOrder": 2, "printLevel": 0})
    walk = trace(lambda: sp.sparsePOP(*structs), end=_makes(sp.ConicProgram))
    yield "`objPoly` from `sparsePOP()` to the vector q", str(walk)
    yield "`u` of a record to a proved interval", str(trace(_interval))
    problem, options = sp.from_structs(*_disc()), sp.Options(order=2)
    walk = trace(lambda: sp.solve(problem, options), _solver, _makes(sp.Certificate))
    yield "a solver's dual to a certificate", str(walk)
    stored = sp.from_json(sp.to_json(sp.solve(problem, options)))
    walk = trace(lambda: stored.certificate.verify(stored.problem))
    yield "`verify` of a stored result", str(walk)


# ---- words and docstrings ---------------------------------------------------------------


def _words() -> Iterator[tuple[str, str]]:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *_files("examples")]
    places = {"the packages": _files(*PACKAGES), "README, docs and examples": pages}
    for place, paths in places.items():
        text = "\n".join(path.read_text(encoding="utf-8") for path in paths)
        for kind, words in (("the field's words", FIELD_WORDS), ("private words", PRIVATE_WORDS)):
            counts = [(w, len(re.findall(rf"(?<![a-z]){w}", text, re.IGNORECASE))) for w in words]
            yield f"{kind} in {place}", ", ".join(f"{word} {count}" for word, count in counts)


def _docstrings() -> Iterator[tuple[str, str]]:
    found: dict[str, list[bool]] = {"modules": [], "classes and functions": []}
    for path in _files(*PACKAGES):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                kind = "modules" if isinstance(node, ast.Module) else "classes and functions"
                text = ast.get_docstring(node)
                if text:
                    found[kind].append(_RIDDLE.match(text) is not None)
    for kind, riddles in found.items():
        yield f"docstrings of {kind} that begin with What/How/Where ...", _share(riddles)


def _public() -> Iterator[tuple[str, str]]:
    """What the docstrings of public names lack."""
    things = [getattr(package, name) for package in (sp, setid) for name in package.__all__]
    functions = [inspect.getdoc(each) or "" for each in things if inspect.isfunction(each)]
    yield "public functions without an example", _share([">>>" not in f for f in functions])
    classes = {each for each in things if inspect.isclass(each)}
    bare = ["Parameters\n---" not in text for each in classes for text in _methods(each)]
    yield "public methods with arguments, without Parameters", _share(bare)


def _methods(kind: type) -> Iterator[str]:
    """Docstrings of the public methods of a class itself that take arguments."""
    for name, value in vars(kind).items():
        method = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if inspect.isfunction(method) and not name.startswith("_"):
            if set(inspect.signature(method).parameters) - {"self", "cls"}:
                yield inspect.getdoc(method) or ""


def _share(found: list[bool]) -> str:
    return f"{sum(found)} of {len(found)}"


# ---- start-up and trusted code ----------------------------------------------------------


def _seconds() -> Iterator[tuple[str, str]]:
    """CPU seconds, user and system, of imports in fresh interpreters, in turn."""
    measured: dict[str, list[float]] = {name: [] for name in _IMPORTS}
    usual = {name: value for name, value in os.environ.items() if name not in _UNUSUAL}
    with TemporaryDirectory() as folder:
        environment = usual | {"PYTHONPYCACHEPREFIX": folder}  # all is compiled, in the warm-up
        for name, times in list(measured.items()) * (_REPEATS + 1):
            code = f"import time; t = time.process_time(); import {name}; "
            run = [sys.executable, "-c", code + "print(time.process_time() - t)"]
            times.append(float(subprocess.check_output(run, cwd=ROOT, env=environment)))
    seconds = {name: median(times[1:]) for name, times in measured.items()}  # after a warm-up
    base = seconds[_IMPORTS[0]]
    for name in PACKAGES:
        text = f"{seconds[name] / base:.2f} ({seconds[name]:.2f} s over {base:.2f} s)"
        yield f"CPU time of `import {name}` over `import {_IMPORTS[0]}`", text


def _trusted() -> Iterator[tuple[str, str]]:
    for name in TRUSTED:
        if (ROOT / name).is_dir():
            files = _files(name)
            yield f"lines of trusted code: `{name}`", f"{_lines(files)} in {len(files)} files"
