"""The command ``sparsepop verify``: check stored certificates again, without any solver."""

from __future__ import annotations

import argparse
from typing import Any

from sparsepop_py.commands.parsers import add_command
from sparsepop_py.errors import ClaimError, ProblemError
from sparsepop_py.formats import read
from sparsepop_py.io.json_files.files import read_json
from sparsepop_py.io.json_files.references import check_references
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.rational_bound import RationalCertificate

__all__ = ["add_verify"]

_TEXT = "check a stored certificate again, without any solver"
_CODES = """exit codes:
  0  every claim in the file is proved
  1  a claim does not follow, and why
  2  the input is wrong (the message is on standard error)

The program checker/ of the source distribution checks the same files and shares no code.
"""


def add_verify(commands: Any) -> None:
    """Add the command to a command line.

    Parameters
    ----------
    commands : argparse subparsers
    """
    command = add_command(commands, "verify", _TEXT, _run, _CODES)
    command.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a stored result; or a problem of any format and its certificate",
    )


def _run(arguments: argparse.Namespace) -> int:
    try:
        lines = verified(arguments.files)
    except ClaimError as error:
        lines = [f"NOT PROVED  {error}"]
    print("\n".join(lines))
    return 1 if any(line.startswith("NOT PROVED") for line in lines) else 0


def verified(files: list[str]) -> list[str]:
    """List what files prove, a line a claim."""
    if len(files) > 2:
        raise ProblemError(
            f"verify: found {len(files)} files, expected a result, or a problem and its certificate"
        )
    found = read_json(files[-1])
    if len(files) == 2:
        return _against(read(files[0]), found, files[-1])
    if not isinstance(found, (Result, RationalResult)):
        raise ProblemError(
            f"{files[0]}: found a {type(found).__name__}, expected a result; give the problem first"
        )
    return _claims(found)


def _against(problem: Problem | RationalProblem, found: Any, path: str) -> list[str]:
    """Check a certificate for the problem of another file."""
    if isinstance(found, (Result, RationalResult)):
        if found.problem.fingerprint != problem.fingerprint:
            return [f"NOT PROVED  {path} belongs to another problem"]
        return _claims(found)
    if not isinstance(found, (Certificate, RationalCertificate)):
        raise ProblemError(f"{path}: found a {type(found).__name__}, expected a certificate")
    if isinstance(found, Certificate) and isinstance(problem, Problem):
        check_references(found, problem, path)
    return [*_bound(problem, found), *_remarks(problem)]


def _claims(result: Result | RationalResult) -> list[str]:
    """Check the claims of a result, whose point was proved again by the reader."""
    lines = []
    if result.certificate is not None:
        lines += _bound(result.problem, result.certificate)
    if result.status is Status.UNBOUNDED:
        lines.append("proved: the objective falls without limit")
    elif result.attained is not None:
        lines.append(f"attained: objective <= {result.upper_bound!r}")
    return [*lines, *_remarks(result.problem)] if lines else ["nothing is claimed"]


def _bound(problem: Any, certificate: Certificate | RationalCertificate) -> list[str]:
    verdict = certificate.verify(problem)
    if not verdict.ok:
        return [f"NOT PROVED  {verdict.reason}"]
    if certificate.bound == float("inf"):
        return ["proved: no point is feasible"]
    return [f"proved: objective >= {float(certificate.bound)!r}"]


def _remarks(problem: Problem | RationalProblem) -> list[str]:
    if problem.sense == "max":
        return ["(objective is the negative of what is maximised)"]
    return []
