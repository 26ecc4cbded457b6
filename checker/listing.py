"""Print the code that a check rests on: ``python checker/listing.py`` and arguments of check.py.

The whole program takes a day to read. One check needs a part of it: the functions that were
called, with the classes and constants that they name. This program does the check, then prints
these parts, modules that others import first. No check needs this program. A function that was not
called decided nothing, but for those that make constants where modules are imported.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from checker.command import main

HERE = Path(__file__).resolve().parent
MALFORMED = 2  # exit code
Called = set[tuple[str, int]]  # files, and lines where functions begin


def called_by(arguments: list[str]) -> tuple[int, Called]:
    """Check the files; return the exit code and the functions that were called."""
    called: Called = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            called.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

    sys.setprofile(note)
    try:
        return main(arguments), called
    finally:
        sys.setprofile(None)


class Module:
    """The statements of a file, and those of them that take part."""

    def __init__(self, path: Path, called: Called) -> None:
        self.path, self.lines = path, path.read_text(encoding="utf-8").splitlines()
        self.left: list[ast.stmt] = []  # classes, constants and what else is no function
        self.taken: list[ast.stmt] = []
        self.dropped: list[ast.stmt] = []  # methods that were not called
        for statement in ast.parse("\n".join(self.lines)).body:
            if isinstance(statement, ast.FunctionDef):
                self.taken += [statement] if self.was_called(statement, called) else []
            elif isinstance(statement, ast.ClassDef):
                methods = [part for part in statement.body if isinstance(part, ast.FunctionDef)]
                self.dropped += [part for part in methods if not self.was_called(part, called)]
                taken = any(part not in self.dropped for part in methods)
                (self.taken if taken else self.left).append(statement)
            elif not isinstance(statement, ast.Import | ast.ImportFrom | ast.Expr):
                self.left.append(statement)

    def was_called(self, function: ast.FunctionDef, called: Called) -> bool:
        """Tell whether a function, or one inside of it, was called."""
        first = min(part.lineno for part in (function, *function.decorator_list))
        rows = range(first, (function.end_lineno or first) + 1)
        return any((str(self.path), row) in called for row in rows)

    def names(self) -> set[str]:
        """Collect the names in what takes part."""
        dropped = {id(node) for part in self.dropped for node in ast.walk(part)}
        nodes = [node for part in self.taken for node in ast.walk(part) if id(node) not in dropped]
        found = {node.id for node in nodes if isinstance(node, ast.Name)}
        return found | {node.attr for node in nodes if isinstance(node, ast.Attribute)}

    def take(self, names: set[str]) -> None:
        """Let classes and constants of these names take part."""
        for part in list(self.left):
            targets = {n.id for n in ast.walk(part) if isinstance(n, ast.Name)}
            named = {part.name} if isinstance(part, ast.ClassDef) else targets
            if named & names:
                self.left.remove(part)
                self.taken.append(part)

    def rows(self) -> list[int]:
        """List the rows of the file that take part, from 0."""
        rows = {row for part in self.taken for row in rows_of(part)}
        return sorted(rows - {row for part in self.dropped for row in rows_of(part)})

    def code(self) -> int:
        """Count the rows that take part, docstrings, comments and empty lines aside."""
        prose = set[int]()
        for part in self.taken:
            for node in ast.walk(part):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    prose |= set(rows_of(node))
        texts = [self.lines[row].strip() for row in self.rows() if row not in prose]
        return sum(bool(text) and not text.startswith("#") for text in texts)


def rows_of(node: ast.stmt) -> range:
    """List the rows of a statement with its decorators, from 0."""
    decorators = getattr(node, "decorator_list", [])
    return range(min(part.lineno for part in (node, *decorators)) - 1, node.end_lineno or 0)


def parts(called: Called) -> list[Module]:
    """Find what takes part of each file, those that others import first."""
    names = [name for name in sys.modules if name.startswith("checker.")]
    files = [Path(str(sys.modules[name].__file__)) for name in names]
    modules = [Module(path, called) for path in files]
    count = -1
    while count < (count := sum(len(module.taken) for module in modules)):
        named = set[str]().union(*(module.names() for module in modules))
        for module in modules:
            module.take(named)
    return [module for module in modules if module.taken]


def listing(modules: list[Module]) -> str:
    """Write the parts, after a table of their lines of code."""
    total = sum(module.code() for module in modules)
    lines = [f"# lines of code that this check rests on: {total}"]
    lines += [f"#{m.code():6d}  {m.path.relative_to(HERE).as_posix()}" for m in modules]
    for module in modules:
        lines += [""] * (2 if lines[-1] else 1)
        lines += [f"# ---- {module.path.relative_to(HERE).as_posix()} " + "-" * 40]
        last = -1
        for row in module.rows():
            texts = ["", module.lines[row]] if row > last + 1 else [module.lines[row]]
            lines += [text for text in texts if text or lines[-1]]  # of what was dropped
            last = row
    return "\n".join(lines)


def printed(arguments: list[str]) -> int:
    """Check the files and print the parts, none where the input is malformed."""
    code, called = called_by(arguments)
    if code != MALFORMED:
        sys.stdout.write(listing(parts(called)) + "\n")
    return code


if __name__ == "__main__":
    sys.exit(printed(sys.argv[1:]))
