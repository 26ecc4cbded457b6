"""The files of ``sparsePOP``: SDPA export, detailed and printed reports, the solver's log."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.compat.output import SparsePOPOutput
from sparsepop_py.compat.param import Parameters
from sparsepop_py.compat.report import report
from sparsepop_py.compat.sdp_sizes import BuiltSDP
from sparsepop_py.errors import check_writable
from sparsepop_py.io.sdpa import write_info, write_sdpa
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import Relaxation

__all__ = ["check_files", "write_files"]


def write_files(
    output: SparsePOPOutput, source: Any, parameters: Parameters, built: BuiltSDP | None
) -> None:
    """Write the files that the parameters ask for; reports and logs are appended."""
    if parameters.sdpaDataFile and built is not None:
        path = Path(parameters.sdpaDataFile)
        write_sdpa(built.program, path, "SDP relaxation")
        write_info(path.with_suffix(".info"), *built.map())
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
    """Whether the files that the parameters ask for can be written, before any work.

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
    with open(path, "a", encoding="utf-8") as file:
        file.write(text)


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
    for name, value in sorted(_values(output.param).items()):
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


def _values(param: Parameters) -> dict[str, Any]:
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
