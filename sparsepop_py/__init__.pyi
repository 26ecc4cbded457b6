"""Public names of the package; ``__init__.py`` loads each with its first use."""

from . import problems
from .algebra.matrix_constraints import psd, second_order
from .algebra.polynomial import Constraint, Kind, Polynomial, total, variables
from .algebra.rational import Rational, RationalConstraint, ratio
from .bounding.exact_linear import linear_bounds
from .compat.intervals import sparsePOPintervals
from .compat.mat import read_mat, write_mat
from .compat.output import SparsePOPOutput
from .compat.sparsepop import sparsePOP
from .compat.structs import from_structs, to_structs
from .conic.program import ConicProgram, ConicSolution
from .errors import (
    DenominatorError,
    FormatError,
    OutputError,
    ParameterWarning,
    ProblemError,
    SolverNotFound,
    SparsePOPError,
)
from .formats import read, write
from .io.gams import read_gms, write_gms
from .io.json_files.files import from_json, read_json, to_json, write_json
from .io.other_software.pyomo_ import from_pyomo
from .io.sdpa import read_sdpa, write_sdpa
from .io.text import parse
from .options import Options
from .pipeline import solve, solve_each
from .problem.problem import Problem
from .problem.rational_problem import RationalProblem
from .problem.rounding import Rounding
from .rational.result import RationalResult
from .relaxation.assemble import assemble
from .relaxation.moment import Relaxation, relax
from .relaxation.sparsepop.relaxation import Switches
from .result import Point, Result, Status
from .solvers import solve_conic
from .sparsity.correlative import Cliques, find_cliques
from .study.orders import compare_orders
from .study.problems import Study
from .study.study import StudyStatus
from .study.table import Table
from .verified.arithmetic.display import rounded
from .verified.certificate.certificate import Certificate, Verdict
from .verified.certificate.linear_bound import LinearBound
from .verified.certificate.rational_bound import RangeProof, RationalCertificate
from .verified.points.feasible_point import ProvedPoint

__version__: str

__all__ = [
    "Certificate",
    "Cliques",
    "ConicProgram",
    "ConicSolution",
    "Constraint",
    "DenominatorError",
    "FormatError",
    "OutputError",
    "Kind",
    "LinearBound",
    "Options",
    "ParameterWarning",
    "Point",
    "Polynomial",
    "Problem",
    "ProblemError",
    "ProvedPoint",
    "RangeProof",
    "Rational",
    "RationalCertificate",
    "RationalConstraint",
    "RationalProblem",
    "RationalResult",
    "Relaxation",
    "Result",
    "Rounding",
    "SolverNotFound",
    "SparsePOPError",
    "SparsePOPOutput",
    "Status",
    "Study",
    "StudyStatus",
    "Switches",
    "Table",
    "Verdict",
    "assemble",
    "compare_orders",
    "find_cliques",
    "from_json",
    "from_pyomo",
    "from_structs",
    "linear_bounds",
    "parse",
    "problems",
    "psd",
    "ratio",
    "read",
    "read_gms",
    "read_json",
    "read_mat",
    "read_sdpa",
    "relax",
    "rounded",
    "second_order",
    "solve",
    "solve_conic",
    "solve_each",
    "sparsePOP",
    "sparsePOPintervals",
    "to_json",
    "to_structs",
    "total",
    "variables",
    "write",
    "write_gms",
    "write_json",
    "write_mat",
    "write_sdpa",
]
