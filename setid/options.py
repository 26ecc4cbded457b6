"""Options of identification: one small frozen class, stored in every result."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import inf
from time import monotonic
from typing import Literal

import sparsepop_py as sp
from setid.data.checks import number, word
from setid.errors import SetidError
from sparsepop_py.budget import Deadline

__all__ = ["Options", "check_executor", "checked_options", "limited", "with_executor"]

_LEAST = 1e-3  # seconds: what an engine without time is given, to say what is known already


@dataclass(frozen=True, slots=True)
class Options:
    """Options of :func:`identify` and :func:`consistency`.

    Parameters
    ----------
    tol : float
        Gap that counts as closed, as a fraction of the attained width of an interval.
    time_limit : float, optional
        Seconds of wall time for all proofs together, the box of the parameters included. What
        is proved by then is returned; a proof under way and the last checks may take up to half as
        long on top.
    cpu_limit : float, optional
        The same in seconds of CPU time of this process, for shared machines.
    solver : str
        Conic solver of the engine, as of :class:`sparsepop_py.Options`; ``"auto"`` is its own
        choice.
    progress : bool
        Whether to show bounds and seconds while it works: one changing line in a terminal or a
        notebook, by tqdm where that is installed. ``result.report`` shows its parts so.
    unidentifiable : {"refuse", "report"}
        What :func:`identify` does with a block structure whose parameters are not unique for
        want of a normalisation: refuse, or report which ones these are, with proved
        intervals of the others.
    engine : sparsepop_py.Options, optional
        Settings of the engine instead of the usual ones, ``sp.Options(effort="auto")``; the fields
        above take precedence. With ``skip``, which names stages of effort ``"auto"``, the effort
        is ``"auto"``; otherwise :func:`identify` warns of effort ``"presolve"``, which leaves
        most gaps open.

    Raises
    ------
    SetidError
        If a value is outside its range; the message names the option.
    SolverNotFound
        If the solver is unknown or not installed.

    Examples
    --------
    >>> import setid
    >>> setid.Options(tol=1e-2, time_limit=60.0).tol
    0.01
    """

    tol: float = 1e-3
    time_limit: float | None = None
    cpu_limit: float | None = None
    solver: str = "auto"
    progress: bool = True
    engine: sp.Options | None = None
    unidentifiable: Literal["refuse", "report"] = "refuse"

    def __post_init__(self) -> None:
        if not number(self.tol, "Options.tol", SetidError) > 0:
            raise SetidError(f"Options.tol: found {self.tol!r}, expected a number > 0")
        for name, limit in (("time_limit", self.time_limit), ("cpu_limit", self.cpu_limit)):
            if limit is not None and not number(limit, f"Options.{name}", SetidError) > 0:
                raise SetidError(f"Options.{name}: found {limit!r}, expected seconds > 0")
        word(self.unidentifiable, "Options.unidentifiable", ("refuse", "report"), SetidError)
        if not isinstance(self.progress, bool):
            raise SetidError(f"Options.progress: found {self.progress!r}, expected True or False")
        if self.engine is not None and not isinstance(self.engine, sp.Options):
            raise SetidError(
                f"Options.engine: found {type(self.engine).__name__}, expected sparsepop_py.Options"
            )
        if not isinstance(self.solver, str):
            raise SetidError(f"Options.solver: found {self.solver!r:.60}, expected a name")
        self.for_engine()  # refuses solvers that are not there

    def limits(self) -> Deadline:
        """Start the limits in time of work that begins now."""
        return Deadline(self.time_limit, None, self.cpu_limit)

    def deadline(self) -> float:
        """Compute when work that begins now is to end, by ``time.monotonic``."""
        return self.limits().end

    def within(self, deadline: Deadline, share: float = 1.0) -> Options:
        """Shorten the time to a share of what a deadline leaves.

        Parameters
        ----------
        deadline : Deadline
            Of :meth:`limits`.
        share : float
        """
        part = deadline.part(share)
        left = part.wall_end - monotonic()
        limit = None if left == inf else max(left, _LEAST)
        return replace(self, time_limit=limit, cpu_limit=part.cpu_left)

    def for_engine(
        self, gap_kind: Literal["absolute", "width"] = "width", until: float | None = None
    ) -> sp.Options:
        """Choose the engine's options that go with these.

        Parameters
        ----------
        gap_kind : {"absolute", "width"}
        until : float, optional
            A :meth:`deadline`; the whole time limit begins now when left out.
        """
        base = self.engine or sp.Options(effort="auto")
        if base.skip and base.effort == "presolve":
            base = replace(base, effort="auto")  # what is skipped are stages of that effort
        left = None if until is None else max(until - monotonic(), _LEAST)
        return replace(
            base,
            gap=float(self.tol),
            gap_kind=gap_kind,
            solver=self.solver,
            time_limit=self.time_limit if left is None or left == inf else left,
            cpu_limit=base.cpu_limit if self.cpu_limit is None else self.cpu_limit,
        )


def checked_options(options: Options | None, usual: Options | None = None) -> Options:
    """Return options, the usual ones where None is given.

    Raises
    ------
    SetidError
        If they are none of setid.
    """
    found = options if options is not None else usual or Options()
    if not isinstance(found, Options):
        raise SetidError(f"options: found {type(found).__name__}, expected setid.Options")
    return found


def limited(deadline: Deadline, options: Options | None = None) -> Options:
    """Give options what a deadline leaves, in time or in work of the engine.

    Parameters
    ----------
    deadline : Deadline
        Without a limit of CPU time.
    options : Options, optional
        The usual ones when left out. Their own limit on work stays.
    """
    found, left = options or Options(), deadline.limits
    engine = found.engine or sp.Options(effort="auto")
    if engine.work_limit is None:
        engine = replace(engine, work_limit=left.get("work_limit"))
    return replace(found, engine=engine, time_limit=left.get("time_limit"))


def check_executor(executor: Executor | None) -> None:
    """Check that an executor is one, or None.

    Raises
    ------
    SetidError
    """
    if executor is not None and not isinstance(executor, Executor):
        raise SetidError(
            f"executor: found {executor!r:.60}, expected a concurrent.futures.Executor"
        )


def with_executor(options: Options, executor: Executor | None) -> Options:
    """Have an executor process the nodes of branch and bound, if there is one.

    Parameters
    ----------
    options : Options
    executor : concurrent.futures.Executor or None

    Returns
    -------
    Options
    """
    check_executor(executor)
    if executor is None:
        return options
    engine = options.engine or sp.Options(effort="auto")
    return replace(options, engine=replace(engine, executor=executor))
