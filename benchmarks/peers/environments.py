"""Peers by name, their environments and what their licences say of published figures.

``python -m benchmarks environments`` makes one environment for each peer below
``.bench-env``, which git ignores. A peer that cannot be installed is named, and
the others are made.
"""

from __future__ import annotations

import subprocess
import sys
import venv
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import BenchmarkError

__all__ = ["FOLDER", "PEERS", "Peer", "interpreter", "make", "may_be_published", "peer"]

FOLDER = Path(__file__).resolve().parents[2] / ".bench-env"
_SECONDS = 1200.0  # for one installation


@dataclass(frozen=True)
class Peer:
    """A program beside ours.

    Parameters
    ----------
    name : str
        On the command line, and of its environment.
    title : str
        In tables.
    packages : tuple of str
        What pip installs; none where the adapter asks a program.
    adapter : str
        Script in ``adapters``.
    licence : str
        Short, with what it says of published figures where it says something.
    published : bool
        Whether figures may be published.
    conic : bool
        Whether it gets the conic program of our relaxation instead of the problem.
    arguments : tuple of str
        Further words for the adapter.
    environment : str
        The name of another peer whose environment it shares; its own when empty.
    """

    name: str
    title: str
    packages: tuple[str, ...]
    adapter: str
    licence: str
    published: bool = True
    conic: bool = False
    arguments: tuple[str, ...] = ()
    environment: str = ""


_CVXPY = ("cvxpy", "clarabel", "scs")
_FORBIDS = "evaluation licence of the wheel, section 2.2: no benchmark results may be published"
_ASKS = "shrinkwrap licence, section 2.4 (vii): no benchmark results without written consent"
PEERS = {
    each.name: each
    for each in (
        Peer("scip", "SCIP", ("pyscipopt",), "scip_.py", "Apache 2.0"),
        Peer("gurobi", "Gurobi", ("gurobipy",), "gurobi.py", _FORBIDS, False),
        Peer("xpress", "Xpress", ("xpress",), "xpress_.py", _ASKS, False),
        Peer("copt", "COPT", ("coptpy",), "copt.py", "not in the wheel, so not read", False),
        Peer("maingo", "MAiNGO", ("maingopy",), "maingo.py", "EPL 2.0"),
        Peer("ipopt", "IPOPT", ("casadi",), "ipopt.py", "EPL 2.0, CasADi LGPL 3"),
        Peer("pounce", "pounce", ("pounce-solver",), "pounce_.py", "EPL 2.0"),
        Peer(
            "sumofsquares", "SumOfSquares", ("SumOfSquares", "cvxopt"), "sumofsquares.py", "MIT"
        ),
        Peer(
            "ncpol2sdpa", "ncpol2sdpa", ("ncpol2sdpa", "cvxpy"), "ncpol.py", "GPL 3"
        ),
        Peer("irene", "Irene", ("irene", "cvxopt"), "irene.py", "MIT"),
        Peer(
            "clarabel", "cvxpy Clarabel", _CVXPY, "cvxpy_.py", "Apache 2.0", True, True,
            ("CLARABEL",), "cvxpy",
        ),
        Peer("scs", "cvxpy SCS", _CVXPY, "cvxpy_.py", "MIT", True, True, ("SCS",), "cvxpy"),
        Peer(
            "sdpa", "sdpa-python", ("sdpa-python",), "conic_programs.py", "GPL 2", True, True,
            ("sdpa-python",),
        ),
        Peer(
            "csdp", "CSDP", ("numpy", "scipy"), "conic_programs.py", "EPL 2.0, a program", True,
            True, ("CSDP",),
        ),
        Peer("sparsepop", "SparsePOP", (), "octave.py", "GPL 2, SeDuMi GPL 2"),
    )
}  # fmt: skip
_TITLES = {each.title: each for each in PEERS.values()}


def peer(name: str) -> Peer:
    """The peer of a name.

    Raises
    ------
    BenchmarkError
        If there is none.

    Examples
    --------
    >>> peer("ipopt").title
    'IPOPT'
    """
    if name not in PEERS:
        raise BenchmarkError(f"peer: found {name!r}, expected one of {', '.join(PEERS)}")
    return PEERS[name]


def may_be_published(title: str) -> bool:
    """Whether figures of a program may be published, by its name in tables.

    Examples
    --------
    >>> may_be_published("SCIP"), may_be_published("Gurobi")
    (True, False)
    """
    return title not in _TITLES or _TITLES[title].published


def interpreter(each: Peer, folder: Path | None = None) -> Path | None:
    """The interpreter of a peer, None where its environment is not made."""
    home = (folder or FOLDER) / (each.environment or each.name)
    for place in (home / "bin" / "python", home / "Scripts" / "python.exe"):
        if place.exists() and (home / "ready").exists():
            return place
    return None


def make(names: Iterable[str], folder: Path | None = None) -> Iterator[str]:
    """Make the environments of some peers; one line of text for each.

    Raises
    ------
    BenchmarkError
        If a name is unknown.
    """
    for each in [peer(name) for name in names]:
        if interpreter(each, folder) is not None:
            yield f"{each.name}: there already"
            continue
        home = (folder or FOLDER) / (each.environment or each.name)
        venv.create(home, with_pip=True)
        yield f"{each.name}: {_installed(each, home)}"


def _installed(each: Peer, home: Path) -> str:
    failed = _pip_fails(each, home) if each.packages else ""
    if failed:
        return f"not installed ({failed})"
    (home / "ready").write_text("", encoding="utf-8")
    return f"made; licence: {each.licence}"


def _pip_fails(each: Peer, home: Path) -> str:
    """Install by pip; why that failed, empty where it did not."""
    python = home / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        done = subprocess.run(
            [*command, *each.packages], capture_output=True, text=True, timeout=_SECONDS
        )
    except subprocess.TimeoutExpired:
        return f"not within {_SECONDS:g} s"
    return (done.stderr.strip().splitlines()[-1:] or ["pip failed"])[0] if done.returncode else ""
