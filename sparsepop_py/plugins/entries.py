"""Entries into other packages that are made when both packages are imported.

Pyomo finds solvers in a table that modules fill when they are imported, and looks for no entry
points of other distributions. So the solver ``sparsepop`` is entered when ``pyomo.environ`` is
there, or as soon as it is.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

__all__ = ["enter_pyomo"]

_PYOMO, _SOLVER = "pyomo.environ", "sparsepop_py.pyomo"


def enter_pyomo() -> None:
    """Register the solver of Pyomo now, or once ``pyomo.environ`` has been imported."""
    if _PYOMO in sys.modules:
        _register()
    elif not any(isinstance(finder, _AfterPyomo) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterPyomo())


def _register() -> None:
    with contextlib.suppress(ImportError):  # an older Pyomo must not fail because of this
        importlib.import_module(_SOLVER)


class _AfterPyomo(MetaPathFinder):
    """Finder that watches for one module and leaves the import to the others."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find ``pyomo.environ`` as the other finders do; register after it has run."""
        if fullname != _PYOMO:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is None or spec.loader is None:
            return spec
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            _register()

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
