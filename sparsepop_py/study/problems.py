"""Studies whose tasks are polynomial problems."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import replace
from math import inf, isfinite
from typing import Any

from sparsepop_py.errors import FormatError, ProblemError, entries_of
from sparsepop_py.io.json_files.files import from_json, to_json
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import Result
from sparsepop_py.study.study import BaseStudy, Tags, Work

__all__ = ["Study", "repeatable"]


def repeatable(options: Options) -> Options:
    """Let no decision rest on a clock, where options give no time limit.

    The results of a study are then the same whatever the load of the machine and the number of
    workers.

    Parameters
    ----------
    options : Options

    Returns
    -------
    Options

    Raises
    ------
    ProblemError
        If there is an executor, which cannot be stored.

    Examples
    --------
    >>> repeatable(Options(effort="auto")).work_limit
    inf
    """
    if options.executor is not None:
        raise ProblemError(
            "Options.executor: found one, expected none in a study; give it to Study.run"
        )
    if options.time_limit is None and options.work_limit is None:
        return replace(options, work_limit=inf)
    return options


def _rows(result: Result) -> list[dict[str, Any]]:
    gap = float(result.gap)
    return [
        {
            "sense": result.problem.sense,
            "status": str(result.status),
            "lower_bound": float(result.lower_bound),
            "upper_bound": float(result.upper_bound),
            "gap": gap if isfinite(gap) else None,
            "message": "; ".join(result.notes) or None,
        }
    ]


def _write(result: Result, trusted: tuple[str, ...]) -> bytes:
    return zlib.compress(to_json(result).encode())


def _read(content: bytes, place: str, trusted: tuple[str, ...]) -> Result:
    try:
        found = from_json(zlib.decompress(content).decode())
    except (zlib.error, UnicodeDecodeError) as error:
        raise FormatError(f"{place}: found damaged content: {error}") from error
    assert isinstance(found, Result)
    return found


def _belongs(result: Result, given: tuple[Any, ...]) -> bool:
    problem = given[0]
    return isinstance(problem, Problem) and result.problem.fingerprint == problem.fingerprint


class Study(BaseStudy):
    """Many polynomial problems in one file, solved once each, whatever happens on the way.

    Bounds in the table are those of results: of the objective as it is minimised, also where the
    column ``sense`` says that a file maximises its negative.

    Parameters
    ----------
    path : str or PathLike
        An SQLite file, made where there is none.
    trusted : iterable of str
        Not used for problems.

    Raises
    ------
    FormatError
        If the file is something else, or a study of another kind.
    OutputError
        If it cannot be made.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2 = sp.variables(2)
    >>> study = sp.Study("discs.study")
    >>> for radius in (1, 2):
    ...     disc = sp.Problem(x1 * x2, [x1**2 + x2**2 <= radius])
    ...     study.add(f"radius {radius}", disc, tags={"radius": radius})
    >>> print(study.run(workers=2))
    2 of 2 tasks
    >>> [round(row["lower_bound"], 4) for row in study.table()]
    [-0.5, -1.0]
    >>> sp.Study("discs.study").result("radius 1").status
    <Status.OPTIMAL: 'OPTIMAL'>
    """

    work = Work(
        "solve",
        solve,
        _rows,
        _write,
        _read,
        to_json,
        ("sense", "status", "lower_bound", "upper_bound", "gap"),
        _belongs,
    )

    def add(
        self,
        name: str,
        problem: Problem,
        options: Options | None = None,
        *,
        tags: Tags | None = None,
    ) -> None:
        """Add a problem; the same one again changes nothing.

        Parameters
        ----------
        name : str
            Of its row in the table.
        problem : Problem
        options : Options, optional
            As of :func:`sparsepop_py.solve`. Without ``time_limit`` and ``work_limit`` no
            decision rests on a clock, so that results repeat.
        tags : mapping of str to str or number, optional
            Further columns of its row, such as the seed.

        Raises
        ------
        ProblemError
            If an argument is malformed, or the name belongs to another task.
        OutputError
            If another run writes the file.
        """
        self.add_all([(name, problem, options, tags)])

    def add_all(self, tasks: Iterable[tuple[str, Problem, Options | None, Tags | None]]) -> None:
        """Add many problems, all or none of them; faster than one by one.

        Parameters
        ----------
        tasks : iterable of (name, problem, options, tags)
            As of :meth:`add`.

        Raises
        ------
        ProblemError
            If an argument is malformed, or a name belongs to another task.
        OutputError
            If another run writes the file.
        """
        entries = []
        for number, task in enumerate(entries_of(tasks, "tasks", "a list of tasks")):
            parts = entries_of(task, f"tasks[{number}]", "name, problem, options and tags")
            if not 2 <= len(parts) <= 4:
                raise ProblemError(
                    f"tasks[{number}]: found {len(parts)} entries, "
                    "expected name, problem, options and tags"
                )
            entries.append(self._task(*parts))
        self._add(entries)

    def _task(self, name: str, problem: Any, options: Any = None, tags: Tags | None = None) -> Any:
        if not isinstance(problem, Problem):
            raise ProblemError(f"problem: found {type(problem).__name__}, expected a Problem")
        if options is not None and not isinstance(options, Options):
            raise ProblemError(f"options: found {type(options).__name__}, expected Options")
        return self._entry(name, (problem, repeatable(options or Options())), tags)
