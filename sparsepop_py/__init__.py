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

from sparsepop_py import problems
from sparsepop_py.algebra.matrix_constraints import psd, second_order
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total, variables
from sparsepop_py.bounding.exact_linear import LinearBound, linear_bounds
from sparsepop_py.compat.mat import read_mat, write_mat
from sparsepop_py.compat.output import SparsePOPOutput
from sparsepop_py.compat.sparsepop import sparsePOP
from sparsepop_py.compat.structs import from_structs, to_structs
from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.errors import (
    FormatError,
    ParameterWarning,
    ProblemError,
    SolverNotFound,
    SparsePOPError,
)
from sparsepop_py.io.gams import read_gms, write_gms
from sparsepop_py.io.json_ import from_json, read_json, to_json, write_json
from sparsepop_py.io.sdpa import read_sdpa, write_sdpa
from sparsepop_py.io.text import parse
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.assemble import assemble
from sparsepop_py.relaxation.moment import Relaxation, relax
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.result import Point, Result, Status
from sparsepop_py.solve import solve, solve_each
from sparsepop_py.solvers import solve_conic
from sparsepop_py.sparsity.correlative import Cliques, find_cliques
from sparsepop_py.verified.certificate.certificate import Certificate, Verdict
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = [
    "Certificate",
    "Cliques",
    "ConicProgram",
    "ConicSolution",
    "Constraint",
    "FormatError",
    "Kind",
    "LinearBound",
    "Options",
    "ParameterWarning",
    "Point",
    "Polynomial",
    "Problem",
    "ProblemError",
    "ProvedPoint",
    "Relaxation",
    "Result",
    "SolverNotFound",
    "SparsePOPError",
    "SparsePOPOutput",
    "Status",
    "Switches",
    "Verdict",
    "assemble",
    "find_cliques",
    "from_json",
    "from_structs",
    "linear_bounds",
    "parse",
    "problems",
    "psd",
    "read_gms",
    "read_json",
    "read_mat",
    "read_sdpa",
    "relax",
    "second_order",
    "solve",
    "solve_conic",
    "solve_each",
    "sparsePOP",
    "to_json",
    "to_structs",
    "total",
    "variables",
    "write_gms",
    "write_json",
    "write_mat",
    "write_sdpa",
]
