"""Proved bounds for sparse polynomial optimization problems.

    problem -> presolve -> sparsity -> relaxation -> conic -> solvers -> certificate -> result

A polynomial problem comes in as SparsePOP structs, a ``.gms`` file, text or Python
expressions; out come a proved lower bound, an attained upper bound with its point, the
gap and a status.

Examples
--------
>>> import sparsepop_py as sp
>>> problem = sp.parse("min x1^2 - x1*x2; s.t. 1 - x1^2 >= 0; 1 - x2^2 >= 0")
>>> result = sp.solve(problem, sp.Options(order=2))
>>> abs(result.lower_bound + 0.25) < 1e-6, bool(result.certificate.verify(problem).ok)
(True, True)
"""

from typing import Any

import lazy_loader

from sparsepop_py.plugins.entries import enter_pyomo

# Names come from __init__.pyi. Importing the package loads none of its rooms: no solver, no scipy.
_lazy, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name != "__version__":
        return _lazy(name)
    from importlib import metadata

    try:
        return metadata.version("sparsepop-py")
    except metadata.PackageNotFoundError:
        return "(not installed)"


enter_pyomo()
del enter_pyomo
