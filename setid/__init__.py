"""Guaranteed parameter intervals from measured data with bounded noise.

    data, structure, noise, priors -> formulate -> Formulation: a polynomial problem

:func:`formulate` states what the data and the noise bounds say of the parameters as a
polynomial optimization problem with named unknowns, whose proved bounds (see
:mod:`sparsepop_py`) become parameter uncertainty intervals.

Examples
--------
>>> import setid, sparsepop_py as sp
>>> data = setid.IOData(u=[4, -3, 2, 1], y=[0, -6.25, 1.175, 2.0875])
>>> model = setid.TransferFunction(na=1, nb=1)
>>> formulation = setid.formulate(data, model, setid.Noise(equation=0.5))
>>> least = sp.solve(formulation.problem).lower_bound
>>> round(least, 5)
-0.52326
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import lazy_loader

# Names come from __init__.pyi. Importing the package loads none of its rooms: no solver, no scipy.
_lazy, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


# Public names that are modules, not names of one.
_MODULES = {
    "control": "setid.control",
    "estimators": "setid.feasible_points.estimators",
    "neural": "setid.neural",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name == "__version__":  # one distribution holds both packages
        return import_module("sparsepop_py").__version__
    return _lazy(name)


class _Face(ModuleType):
    """A package whose functions keep their names when modules of the same name are imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and name in __all__ and name not in _MODULES:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
