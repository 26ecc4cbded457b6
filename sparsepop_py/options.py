"""Options of a solve: one frozen class, stored in every result."""

from __future__ import annotations

import numbers
import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sparsepop_py.errors import ProblemError, entries_of, shown

if TYPE_CHECKING:
    from sparsepop_py.relaxation.sparsepop.relaxation import Switches

__all__ = ["SKIPPED", "Options"]

SKIPPED = (
    "linear",
    "star",
    "split",
    "mixed",
    "full",
    "monomials",
    "partners",
    "chordal",
    "components",
    "inverse",
    "obbt_lp",
    "obbt_sdp",
    "quote",
    "cutoff",
    "branch",
    "linear_tree",
    "working_set",
)

_OLD_SKIPPED = {"narrow": "obbt_lp", "squeeze": "obbt_sdp"}  # accepted until the version after next

_INTEGERS = {
    "order": (1, "a positive integer"),
    "node_limit": (0, "an integer >= 0"),
    "max_iterations": (1, "an integer >= 1"),
    "seed": (0, "an integer >= 0"),
}
_NUMBERS = {
    "gap": "a number >= 0",
    "tolerance": "a number >= 0",
    "time_limit": "seconds > 0",
    "cpu_limit": "seconds > 0",
    "search_limit": "seconds >= 0",
    "work_limit": "a number > 0",
    "memory_limit": "a number > 0",
    "accuracy": "a number > 0",
}
_OPTIONAL = (
    "order",
    "node_limit",
    "max_iterations",
    "time_limit",
    "cpu_limit",
    "search_limit",
    "work_limit",
    "accuracy",
)
_CHOICES = {
    "effort": ("plain", "presolve", "auto"),
    "gap_kind": ("absolute", "relative", "width"),
    "chordal": ("auto", "min-degree", "min-fill", "mcs-m"),
    "refine": ("scipy", "ipopt", "prove", "none"),
}


@dataclass(frozen=True)
class Options:
    """Options of :func:`sparsepop_py.solve`.

    Parameters
    ----------
    order : int, optional
        Relaxation order; the least legal one when left out, raised to it when smaller.
    effort : {"presolve", "plain", "auto"}
        ``"plain"``: scaling and exactly the relaxation of that order. ``"presolve"``:
        finite boxes too, by interval propagation and an objective cutoff. ``"auto"``: a
        hierarchy of relaxations, linear to high orders, and branch and bound, while the gap
        is open, starting at ``order`` when given; give a ``time_limit`` with it.
    gap : float
        The gap that counts as closed.
    gap_kind : {"relative", "absolute", "width"}
        Relative gaps are divided by max(1, |attained value|); with ``"width"``, which
        needs pairs of objectives p and -p, by the distance of the two attained values.
    tolerance : float
        Largest violation, in the user's units, of points that are worth showing.
    sparse : bool
        Exploit correlative sparsity; False makes one clique of all variables.
    chordal : {"auto", "min-degree", "min-fill", "mcs-m"}
        Heuristic that makes the sparsity graph chordal. ``"auto"`` tries those that the size
        allows and takes the smallest largest clique; the others give the same cliques whatever
        the version.
    solver : str
        ``"auto"`` (the clique-tree method where it suits, else Clarabel), ``"clarabel"``,
        ``"clarabel-moment"``, ``"cliquetree"`` or ``"cvxpy:NAME"``.
    refine : {"scipy", "ipopt", "prove", "none"}
        Local search for attained points. ``"ipopt"`` needs the extra of that name; ``"prove"``
        proves the start that was given and points of relaxations as they are, without a search;
        ``"none"`` leaves out even that.
    search_limit : float, optional
        Seconds of CPU time, or units of work under a ``work_limit``, that local searches may take
        in all; of several objectives, each for itself.
    branch_on : sequence of int, optional
        Variables (from 0) for branch and bound to branch on; those that cover all products
        when left out.
    node_limit : int, optional
        Most nodes that branch and bound processes; 0 switches it off.
    executor : concurrent.futures.Executor, optional
        Processes the nodes of branch and bound, and the objectives of ``solve_each``. Where it
        breaks, they are processed here, with a note. It is not pickled with the options.
    skip : sequence of str, optional
        Steps of effort ``"auto"`` to leave out, for comparisons: relaxations by shape
        (``"linear"``, ``"star"``, ``"split"``, ``"mixed"``, ``"full"``), by cliques
        (``"monomials"``, ``"partners"``) or by terms (``"chordal"``, ``"components"``);
        ``"inverse"`` (first bounds from linear rows), ``"obbt_lp"`` (bound tightening by
        linear programs), ``"obbt_sdp"`` (... by semidefinite relaxations, in branch and
        bound), ``"quote"`` (bounds of one objective used for others), ``"cutoff"``,
        ``"branch"``, ``"linear_tree"`` (branch and bound by linear programs alone, which
        small problems of degree 2 begin with), ``"working_set"`` (bounds from the constraints
        that bind, in problems with many).
    time_limit : float, optional
        Seconds of wall time. Each solver call gets what is left; the best proved state so
        far is returned, with status LIMIT where the gap is open. A proof under way and the last
        verification of the certificate may take up to half as long on top.
    cpu_limit : float, optional
        The same in seconds of CPU time of this process, and of tasks of ``executor``, for shared
        machines. Solvers that know wall time only get what that is expected to last.
    work_limit : float, optional
        Units of work, each about a second of one core, counted by a fixed model
        (:mod:`sparsepop_py.budget`). With it, and without limits in time, no decision rests on a
        clock: runs are reproducible, and a run with a larger limit begins like one with a
        smaller limit. The last step may exceed it.
    memory_limit : float
        Bytes that one relaxation may take in a solver, estimated; larger ones are replaced by
        weaker ones, with a note.
    accuracy : float, optional
        Gap and residuals at which a conic solver may stop, in scaled units; chosen where
        left out.
    max_iterations : int, optional
        Most iterations of a conic solver (Clarabel and the clique-tree method).
    switches : Switches, optional
        With effort ``"plain"``: the relaxation of Waki, Kim, Kojima and Muramatsu under
        SparsePOP's switches, its order among them; see
        :mod:`sparsepop_py.relaxation.sparsepop.relaxation`.
    seed : int
        Seed of random starting points.
    progress : bool
        Whether to show stage, bounds and seconds while it works: one changing line in a terminal
        or a notebook, by tqdm where that is installed (``pip install 'sparsepop-py[progress]'``).

    Raises
    ------
    ProblemError
        If a value is outside its range; the message names the option.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> sp.Options(order=2, effort="auto", time_limit=60.0).gap
    1e-06
    >>> sp.Options(order=0)
    Traceback (most recent call last):
    ...
    sparsepop_py.errors.ProblemError: Options.order: found 0, expected a positive integer
    """

    order: int | None = None
    effort: Literal["plain", "presolve", "auto"] = "presolve"
    gap: float = 1e-6
    gap_kind: Literal["relative", "absolute", "width"] = "relative"
    tolerance: float = 1e-6
    sparse: bool = True
    chordal: Literal["auto", "min-degree", "min-fill", "mcs-m"] = "auto"
    solver: str = "auto"
    refine: Literal["scipy", "ipopt", "prove", "none"] = "scipy"
    search_limit: float | None = None
    branch_on: Sequence[int] | None = None
    node_limit: int | None = None
    executor: Executor | None = None
    skip: Sequence[str] = ()
    time_limit: float | None = None
    cpu_limit: float | None = None
    work_limit: float | None = None
    memory_limit: float = 5e9
    accuracy: float | None = None
    max_iterations: int | None = None
    switches: Switches | None = None
    seed: int = 0
    progress: bool = False

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in choices:
                raise self._wrong(name, "one of " + ", ".join(map(repr, choices)))
        for name, (least, expected) in _INTEGERS.items():
            value = getattr(self, name)
            if not _is_integer(value, least) and not (value is None and name in _OPTIONAL):
                huge = isinstance(value, numbers.Integral) and int(value) >= 2**63
                raise self._wrong(name, f"{expected} below 2^63" if huge else expected)
        for name, expected in _NUMBERS.items():
            value = getattr(self, name)
            if not _is_number(value, expected) and not (value is None and name in _OPTIONAL):
                raise self._wrong(name, expected)
        if self.accuracy is not None and not float(self.accuracy) < np.inf:
            raise self._wrong("accuracy", _NUMBERS["accuracy"])
        self._check_kinds()
        self._check_skip()
        if self.switches is not None:
            self._check_switches()
            if self.effort != "plain":
                raise ProblemError(
                    f"Options.switches: found them with effort {self.effort!r}, expected 'plain'"
                )

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the executor, which belongs to its process."""
        return self.__dict__ | {"executor": None}

    def __deepcopy__(self, memo: dict[int, Any]) -> Options:
        """Return the options themselves: nothing in them changes."""
        return self

    def _wrong(self, name: str, expected: str) -> ProblemError:
        return ProblemError(
            f"Options.{name}: found {shown(getattr(self, name))}, expected {expected}"
        )

    def _check_switches(self) -> None:
        # Loaded where it is used: reading stored results must not load relaxations.
        from sparsepop_py.relaxation.sparsepop.relaxation import Switches

        if not isinstance(self.switches, Switches):
            raise ProblemError(f"Options.switches: found {self.switches!r}, expected Switches")

    def _check_solver_name(self) -> None:
        if not isinstance(self.solver, str):
            raise ProblemError(f"Options.solver: found {self.solver!r}, expected a name")
        if self.solver != "auto":
            from sparsepop_py.solvers import require_solver

            require_solver(self.solver)

    def _check_skip(self) -> None:
        expected = "some of " + ", ".join(SKIPPED)
        names = tuple(entries_of(self.skip, "Options.skip", expected))
        object.__setattr__(self, "skip", _renamed(names))
        if any(not isinstance(n, str) or n not in SKIPPED for n in self.skip):
            raise self._wrong("skip", expected)

    def _check_kinds(self) -> None:
        if self.branch_on is not None:
            chosen = entries_of(self.branch_on, "Options.branch_on", "variable numbers from 0")
            if not all(_is_integer(v, 0) for v in chosen):
                raise self._wrong("branch_on", "variable numbers from 0")
            object.__setattr__(self, "branch_on", tuple(int(v) for v in chosen))
        if self.executor is not None and not isinstance(self.executor, Executor):
            raise self._wrong("executor", "an Executor")
        self._check_solver_name()
        for name in ("sparse", "progress"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise self._wrong(name, "True or False")


def _is_integer(value: object, least: int) -> bool:
    """Check for an integer from ``least`` to below 2^63 that is no bool."""
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return whole and least <= int(value) < 2**63  # type: ignore[call-overload]


def _is_number(value: object, expected: str) -> bool:
    """Check for a number that a double holds: >= 0, or > 0 where expected."""
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return False
    try:
        number = float(value)
    except OverflowError:
        return False
    return number > 0 if expected.endswith("> 0") else number >= 0


def _renamed(names: tuple[str, ...]) -> tuple[str, ...]:
    """Replace names of earlier versions by the present ones, with a DeprecationWarning."""
    old = [name for name in names if isinstance(name, str) and name in _OLD_SKIPPED]
    for name in old:
        text = f"Options.skip: {name!r} is now called {_OLD_SKIPPED[name]!r}"
        warnings.warn(text, DeprecationWarning, stacklevel=5)
    return tuple(_OLD_SKIPPED[name] if name in old else name for name in names)
