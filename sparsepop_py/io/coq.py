"""Write certificates as Coq files, by the export of the second checker.

The export belongs to the program ``checker/``, which shares no code with this package: problem and
certificate are handed over as JSON files. It covers trees whose ends are identities of squares,
linear duals, empty boxes or boxes that are enough.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import sparsepop_py
from sparsepop_py.errors import OutputError, ProblemError
from sparsepop_py.files import as_path, write_text
from sparsepop_py.io.json_files.files import write_json
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.certificate.certificate import Certificate

__all__ = ["write_coq"]


def write_coq(certificate: Certificate, path: str | Path, problem: Problem) -> None:
    """Write a Coq file that proves the bound from the problem in rationals.

    Parameters
    ----------
    certificate : Certificate
    path : str or Path
        Ends in ``.v``; check it by ``coqc``. Coq 8.16 and its standard library are enough.
    problem : Problem

    Raises
    ------
    ProblemError
        If the certificate belongs to another problem, or holds an argument that the export
        does not cover; the message names it.
    OutputError
        If the file cannot be written, or the program ``checker/`` is not there.

    Examples
    --------
    >>> import sparsepop_py as sp, pathlib, tempfile
    >>> x, = sp.variables(1)
    >>> problem = sp.Problem(x**2 - x, lower=0, upper=1)
    >>> certificate = sp.solve(problem).certificate
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_coq(certificate, pathlib.Path(folder) / "proof.v", problem)
    ...     "Theorem" in (pathlib.Path(folder) / "proof.v").read_text()
    True
    """
    if not certificate.verify(problem).ok:
        raise ProblemError("to_coq: found a certificate that does not hold for this problem")
    program = _program()
    as_path(path)
    with tempfile.TemporaryDirectory() as folder:
        stated, proof, text = (Path(folder) / name for name in ("p.json", "c.json", "proof.v"))
        write_json(problem, stated)
        write_json(certificate, proof)
        done = subprocess.run(
            [sys.executable, str(program), str(stated), str(proof), str(text)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            found = done.stdout.strip() or done.stderr.strip()[-200:]
            raise ProblemError(
                f"to_coq: {found}; a certificate of fewer kinds of steps may do: solve with effort "
                "'presolve', or with skip=['linear_tree']"
            )
        write_text(path, text.read_text(encoding="utf-8"))


def _program() -> Path:
    """Find the export of the second checker, installed with the package or beside it."""
    package = Path(sparsepop_py.__file__).resolve().parent
    for folder in (package, package.parent):
        program = folder / "checker" / "coq.py"
        if program.is_file():
            return program
    raise OutputError(
        f"to_coq: found no checker/coq.py in {package.parent}, expected the source distribution "
        "or a checkout beside the package"
    )
