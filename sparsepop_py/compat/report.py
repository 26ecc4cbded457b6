"""The printed report of ``sparsePOP``, in the layout of the original.

Proved values are rounded outwards when they are shortened, so that what is shown is as
proved as what is returned.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.compat.output import POPOutput, SparsePOPOutput
from sparsepop_py.compat.param import Parameters
from sparsepop_py.compat.param_table import FIELDS
from sparsepop_py.compat.sdp_sizes import BuiltSDP
from sparsepop_py.errors import OutputError, ParameterWarning, check_writable
from sparsepop_py.io.sdpa import write_info, write_sdpa
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.result import Status
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["check_files", "report", "write_files", "write_report"]

_LINE = "-" * 72
_PHASES = {"solved": "pdOPT", "almost": "pdFEAS"}  # in SDPA's words


def write_report(output: SparsePOPOutput, source: Any, level: int) -> None:
    """Write the report to standard output; ``level`` 0: nothing, 1: without the point."""
    if level > 0:
        sys.stdout.write(report(output, source, level))


def report(output: SparsePOPOutput, source: Any, level: int) -> str:
    """Format the report of a solve."""
    return "\n".join(_lines(output, source, level)) + "\n"


def _lines(output: SparsePOPOutput, source: Any, level: int) -> Iterator[str]:
    yield _LINE
    yield "SparsePOP in Python: proved bounds of polynomial optimization problems"
    yield _LINE
    if source is not None:
        yield f"# Problem File Name   = {source}"
    yield "# parameters:"
    yield from _parameters(output)
    yield from _sdp(output)
    yield "# Approximate optimal value information:"
    yield from _value_lines(output)
    times = output.cpuTime
    yield "# elapsed time (CPU seconds):"
    yield f"  conversion          = {times.conversion:10.2f}"
    yield f"  SDP solver          = {times.SDPsolver:10.2f}"
    yield f"  certification       = {times.certification:10.2f}"
    yield f"  total               = {times.total:10.2f}"
    yield f"  local search        = {times.localMethod:10.2f}"
    if level > 1:
        yield from _vector("POP.xVect", output.POP.xVect)
        yield from _vector("POP.xVectL", output.POP.xVectL)
    for note in output.POP.notes:
        yield f"# note: {note}"


def _parameters(output: SparsePOPOutput) -> Iterator[str]:
    param = output.param
    yield f"  relaxOrder          = {param.relaxOrder}"
    yield f"  sparseSW            = {param.sparseSW}"
    if not param.tighten:
        yield f"  tighten             = {param.tighten}"
    if param.POPsolver:
        yield f"  POPsolver           = {param.POPsolver}"
    if param.SDPsolver != "sedumi":
        yield f"  SDPsolver           = {param.SDPsolver}"
    for entry in FIELDS:
        value = param.given.get(entry.name, entry.default)
        if entry.name in param.given and value != entry.default:
            yield f"  {entry.name:19} = {value}"


def _sdp(output: SparsePOPOutput) -> Iterator[str]:
    info, sizes = output.SDPsolverInfo, output.SDPinfo
    if not sizes.rowSizeA:
        yield "# SDP: none was solved"
        return
    blocks = sizes.SDPblock
    yield f"# SDP solved by {info.solver}:" if info.solver else "# SDP, not solved:"
    yield f"  size of A           = [{sizes.rowSizeA},{sizes.colSizeA}]"
    yield f"  nonzeros in A       = {sizes.nonzerosInA}"
    yield f"  free variables      = {sizes.noOfFreevar}"
    yield f"  LP variables        = {sizes.noOfLPvariables}"
    yield f"  SDP blocks          = {len(blocks)}, largest {max(blocks, default=0)}"
    if not info.solver:
        return
    yield f"# {info.solver} information:"
    yield f"  numerr, pinf, dinf  = {info.numerr}, {info.pinf}, {info.dinf}  ({info.detail})"
    yield f"  iterations          = {info.iter}"
    if output.param.SDPsolver == "sdpa":  # programs that asked for SDPA look for its last word
        solution = output.POP.result.solution
        yield f"  phase value = {_PHASES.get(solution.status if solution else '', 'noINFO')}"
    if info.dinf == 1:
        yield "  it reports that the relaxation has no point: nor may the problem (not proved)"
    if info.pinf == 1:
        yield "  it reports no sum of squares of this order: a higher one or bounds may help"


def _value_lines(output: SparsePOPOutput) -> Iterator[str]:
    POP, value = output.POP, output.SDPobjValue
    if value is None:
        yield "  SDPobjValue         = none: the SDP was not to be solved"
        return
    maximise = POP.result.problem.sense == "max"
    proved = f"proved {'upper' if maximise else 'lower'} bound"
    if not math.isfinite(value):
        empty = POP.status is Status.INFEASIBLE
        proved = "proved: no point is feasible" if empty else "nothing finite is proved"
    yield f"  SDPobjValue         = {rounded(value, maximise, 8, scientific=True)}  {proved}"
    if POP.solverValue is not None:
        yield f"  POP.solverValue     = {POP.solverValue:+13.7e}  value of the SDP, no bound"
    if POP.objValue is not None:
        found = _kind(output)
        yield f"  POP.objValue        = {POP.objValue:+13.7e}  {found}"
        if math.isfinite(value):
            gap = abs(POP.objValue - value) / max(1.0, abs(POP.objValue))
            yield f"  relative obj error  = {gap:+8.2e}"
        yield f"  POP.absError        = {POP.absError:+8.2e}"
        yield f"  POP.scaledError     = {POP.scaledError:+8.2e}"
    if POP.objValueL is not None:
        yield f"  POP.objValueL       = {POP.objValueL:+13.7e}  refined"
        yield f"  POP.absErrorL       = {POP.absErrorL:+8.2e}"
        yield f"  POP.scaledErrorL    = {POP.scaledErrorL:+8.2e}"
    for k, zeta in enumerate(POP.zeta or []):
        yield f"  POP.zeta({k + 1})         = {rounded(zeta, True, 8, scientific=True)}  proved"
    yield f"  status              = {POP.status}: {_message(POP)}"


def _message(POP: POPOutput) -> str:
    """Explain the status: of the solve, unless it was found anew in the given problem."""
    same = POP.status is POP.result.status
    return POP.result.message if same else POP.status.message


def _kind(output: SparsePOPOutput) -> str:
    """Describe the kind of ``POP.xVect``."""
    result, x = output.POP.result, output.POP.xVect
    if result.attained is not None and np.array_equal(x, result.attained.x):
        return "attained, with equations relaxed" if output.param.eqTolerance else "attained"
    if result.x is not None and np.array_equal(x, result.x):
        return "nearly feasible point, not proved"
    if result.moments is not None:
        return "first moments of the SDP, not proved"
    return "point of the bounds nearest to 0, not proved"


def _vector(name: str, x: Any) -> Iterator[str]:
    """Five numbers a line, each with its index, which programs that read reports look for."""
    if not x.size:
        return
    yield f"# {name}:"
    for first in range(0, x.size, 5):
        numbers = (f"{k + 1:8d}: {x[k]:+13.7e}" for k in range(first, min(first + 5, x.size)))
        yield "".join(numbers)


def write_files(
    output: SparsePOPOutput, source: Any, parameters: Parameters, built: BuiltSDP | None
) -> None:
    """Write the files that the parameters ask for; reports and logs are appended."""
    if parameters.sdpaDataFile and built is not None:
        path = Path(parameters.sdpaDataFile)
        write_sdpa(built.program, path, "SDP relaxation")
        write_info(path.with_suffix(".info"), *built.map())
    elif parameters.sdpaDataFile:
        hint = ": tighten = 0 gives the plain relaxation" if parameters.tighten else ""
        warnings.warn(
            f"param.sdpaDataFile: {parameters.sdpaDataFile} was not written, since no SDP was "
            f"needed{hint}",
            ParameterWarning,
            stacklevel=3,
        )
    if isinstance(parameters.printFileName, str) and parameters.printLevel[1]:
        _append(parameters.printFileName, report(output, source, parameters.printLevel[1]))
    if parameters.detailedInfFile:
        _append(parameters.detailedInfFile, "\n".join(_details(output, source, built)) + "\n")
    log = parameters.SDPsolverOutFile
    if log == 1:
        sys.stdout.write(_log(output))
    elif log:
        _append(log, _log(output))


def check_files(parameters: Parameters) -> None:
    """Check before any work that the files of the parameters can be written.

    Raises
    ------
    ProblemError
        That names the field.
    """
    asked = {
        "sdpaDataFile": parameters.sdpaDataFile,
        "printFileName": parameters.printFileName if parameters.printLevel[1] else "",
        "detailedInfFile": parameters.detailedInfFile,
        "SDPsolverOutFile": parameters.SDPsolverOutFile,
    }
    for field, path in asked.items():
        if isinstance(path, str) and path:
            check_writable(path, f"param.{field}")


def _append(path: str, text: str) -> None:
    try:
        with open(path, "a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _log(output: SparsePOPOutput) -> str:
    info = output.SDPsolverInfo
    errors = "" if info.err is None else ", DIMACS errors " + " ".join(f"{e:.1e}" for e in info.err)
    return (
        f"SDP solver {info.solver or 'none'}: {info.detail}, {info.iter} iterations, "
        f"{info.cpusec:.2f} CPU seconds{errors}\n"
    )


def _details(output: SparsePOPOutput, source: Any, built: BuiltSDP | None) -> Iterator[str]:
    """Parameters, the problem, its scaled form, cliques, supports and the SDP."""
    problem = output.POP.result.problem
    if source is not None:
        yield f"# Problem File Name   = {source}"
    yield "# parameters:"
    for name, value in sorted(_parameter_values(output.param).items()):
        yield f"  {name:19} = {value}"
    yield "# POP to be solved:"
    yield from _problem(problem)
    if built is None:
        yield "# SDP: none was built"
        return
    relaxation = built.relaxation
    yield "# Scaled POP:"
    yield from _problem(relaxation.problem)
    yield f"# Cliques: {len(relaxation.cliques.members)}"
    for number, clique in enumerate(relaxation.cliques.members):
        yield f"  {number + 1:5d}: " + " ".join(str(v + 1) for v in clique)
    yield "# Blocks: constraint (0: moment matrix), size and supports of the basis"
    yield from _blocks(relaxation)
    yield "# SDP: " + str(built.program)
    yield "  row, column, value of A in moment form"
    matrix = built.program.A.tocoo()
    for i, j, value in zip(matrix.row.tolist(), matrix.col.tolist(), matrix.data, strict=True):
        yield f"  {i + 1:6d} {j + 1:6d} {value:+.15e}"
    yield "  b"
    yield from (f"  {value:+.15e}" for value in built.program.b)
    yield "  objective"
    yield from (f"  {value:+.15e}" for value in built.program.q)


def _parameter_values(param: Parameters) -> dict[str, Any]:
    names = ("relaxOrder", "sparseSW", "POPsolver", "printLevel", "tighten", "SDPsolver")
    return {**{name: getattr(param, name) for name in names}, **param.given}


def _problem(problem: Problem) -> Iterator[str]:
    yield "  objective"
    yield from _terms(problem.objective)
    for number, constraint in enumerate(problem.constraints):
        yield f"  constraint {number + 1}: {constraint.kind.value} {constraint.name}".rstrip()
        yield from _terms(constraint.polynomial)
    yield "  bounds"
    for v, (low, high) in enumerate(zip(problem.lower, problem.upper, strict=True)):
        yield f"  {v + 1:6d}: {low:+13.7e} {high:+13.7e}"


def _terms(polynomial: Polynomial) -> Iterator[str]:
    for row, value in zip(polynomial.exponents, polynomial.coefficients, strict=True):
        powers = " ".join(f"{v + 1}^{p}" for v, p in zip(row.indices, row.data, strict=True))
        yield f"    {value:+.15e}  {powers or '1'}"


def _blocks(relaxation: Relaxation) -> Iterator[str]:
    m = len(relaxation.problem.constraints)
    for group in relaxation.groups:
        kind = "equation" if group.free else "matrix"
        for number, basis in zip(group.generator.tolist(), group.basis, strict=True):
            what = number if number <= m else f"bound {number - m}"
            yield f"  {what}: {kind} of size {basis.shape[0]}"
            exponents = monomials.to_exponents(basis, relaxation.problem.dimension)
            for row in np.arange(basis.shape[0]):
                one = exponents[[row]].tocoo()
                pairs = zip(one.col.tolist(), one.data.tolist(), strict=True)
                yield "    " + (" ".join(f"{v + 1}^{p}" for v, p in pairs) or "1")
