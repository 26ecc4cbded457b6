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

from . import problems
from .certificate.certificate import Certificate, Verdict
from .cones import psd, second_order
from .conic import ConicProgram, ConicSolution, assemble
from .errors import (
    FormatError,
    ParameterWarning,
    ProblemError,
    SolverNotFound,
    SparsePOPError,
)
from .feasibility import ProvedPoint
from .formats.gms import read_gms, write_gms
from .formats.json_ import from_json, read_json, to_json, write_json
from .formats.mat import read_mat, write_mat
from .formats.sdpa import read_sdpa, write_sdpa
from .formats.text import parse
from .options import Options
from .polynomial import Constraint, Kind, Polynomial, total, variables
from .polytope import LinearBound, linear_bounds
from .problem import Problem
from .relaxation import Relaxation, relax
from .result import Point, Result, Status
from .solve import solve, solve_each
from .solvers import solve_conic
from .sparsepop import sparsePOP
from .sparsepop_output import SparsePOPOutput
from .sparsity import Cliques, find_cliques
from .structs import from_structs, to_structs
from .waki import Switches

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
