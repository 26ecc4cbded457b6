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

import lazy_loader

from sparsepop_py.plugins.entries import enter_pyomo

# Names come from __init__.pyi. Importing the package loads none of its rooms: no solver, no scipy.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

enter_pyomo()
del enter_pyomo
