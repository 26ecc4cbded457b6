"""The printed report of ``sparsePOP``, in the layout of the original.

Proved values are rounded outwards when they are shortened, so that what is shown is as
proved as what is returned.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import Any

from sparsepop_py.compat.output import SparsePOPOutput
from sparsepop_py.compat.param_table import FIELDS
from sparsepop_py.result import Status
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["report", "write_report"]

_LINE = "-" * 72


def write_report(output: SparsePOPOutput, source: Any, level: int) -> None:
    """Write the report to standard output; ``level`` 0: nothing, 1: without the point."""
    if level > 0:
        sys.stdout.write(report(output, source, level))


def report(output: SparsePOPOutput, source: Any, level: int) -> str:
    """The text of the report."""
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
    yield from _values(output)
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
    for note in output.POP.result.notes:
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
    if info.dinf == 1:
        yield "  it reports that the relaxation has no point: nor may the problem (not proved)"
    if info.pinf == 1:
        yield "  it reports no sum of squares of this order: a higher one or bounds may help"


def _values(output: SparsePOPOutput) -> Iterator[str]:
    POP, value = output.POP, output.SDPobjValue
    if value is None:
        yield "  SDPobjValue         = none: the SDP was not to be solved"
        return
    maximise = POP.result.problem.sense == "max"
    proved = f"proved {'upper' if maximise else 'lower'} bound"
    if not math.isfinite(value):
        empty = POP.status is Status.INFEASIBLE
        proved = "proved: no point is feasible" if empty else "nothing finite is proved"
    yield f"  SDPobjValue         = {rounded(value, maximise, 8)}  {proved}"
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
        yield f"  POP.zeta({k + 1})         = {rounded(zeta, True, 8)}  proved"
    yield f"  status              = {POP.status}: {POP.status.message}"


def _kind(output: SparsePOPOutput) -> str:
    """What ``POP.xVect`` is."""
    result = output.POP.result
    if result.options.switches is not None and result.relaxation is not None:
        return "first moments of the SDP, not proved"
    return "attained" if result.attained is not None else "nearly feasible point, not proved"


def _vector(name: str, x: Any) -> Iterator[str]:
    """Five numbers a line, each line with the index of its first entry."""
    if not x.size:
        return
    yield f"# {name}:"
    for first in range(0, x.size, 5):
        numbers = " ".join(f"{v:+13.7e}" for v in x[first : first + 5])
        yield f"  {first + 1:6d}: {numbers}"
