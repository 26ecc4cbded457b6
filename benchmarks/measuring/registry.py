"""Families of problems by name, and what a measurement needs to know of each problem."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sparsepop_py as sp

from ..errors import BenchmarkError

__all__ = ["Case", "Family", "Registry", "Selection", "Task"]


@dataclass(frozen=True, eq=False)
class Task:
    """One feasible set and the objectives to be bounded over it.

    Parameters
    ----------
    problem : Problem
    objectives : tuple of Polynomial
        Those to be minimised; the problem's own where it is the only question.
    labels : tuple of str
        One for each objective.
    pairs : bool
        Whether objectives 2 i and 2 i + 1 are p and -p: together they bound an interval,
        and gaps are relative to its width.
    start_widths : tuple of float
        For pairs, the width of each interval that is known beforehand.
    optimum : float or None
        The known optimum of a single objective.
    """

    problem: sp.Problem
    objectives: tuple[sp.Polynomial, ...]
    labels: tuple[str, ...]
    pairs: bool = False
    start_widths: tuple[float, ...] = ()
    optimum: float | None = None

    @staticmethod
    def of(problem: sp.Problem, optimum: float | None = None) -> Task:
        """The task to minimise the problem's own objective."""
        return Task(problem, (problem.objective,), ("objective",), optimum=optimum)


@dataclass(frozen=True, eq=False)
class Case:
    """A problem that can be made as often as it is measured.

    Parameters
    ----------
    name : str
        The same for all seeds.
    make : callable
        Returns the task; the time it takes is the phase "parse".
    size : int or None
        What grows in this family.
    seed : int
    options : mapping
        Fields of Options that this problem needs, unless the command line sets them.
    """

    name: str
    make: Callable[[], Task]
    size: int | None = None
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Selection:
    """Which cases of a family are wanted; empty means the family's own choice.

    Parameters
    ----------
    names : tuple of str
        Only cases whose name contains one of these.
    sizes, seeds : tuple of int
    noises : tuple of float
        Factors on the noise bounds of the families oe and eiv, per cent of the family identify.
    files : tuple of Path
        Problems of the reader's own.
    count : int
        Number of random problems.
    """

    names: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()
    seeds: tuple[int, ...] = (0,)
    noises: tuple[float, ...] = ()
    files: tuple[Path, ...] = ()
    count: int = 2000

    def wants(self, name: str) -> bool:
        """Whether a case of this name is selected."""
        return not self.names or any(part in name for part in self.names)


@dataclass(frozen=True, eq=False)
class Family:
    """Problems that are measured alike.

    Parameters
    ----------
    name, summary : str
    cases : callable
        From a selection to cases.
    kind : {"solve", "build", "random", "identify"}
        What is measured: bounds, sizes without a solver, soundness, or identification.
    options : mapping
        Fields of Options for all cases.
    peer_limit : float
        CPU seconds of a peer for one objective, unless the command line says otherwise.
    """

    name: str
    summary: str
    cases: Callable[[Selection], Iterable[Case]]
    kind: str = "solve"
    options: Mapping[str, Any] = field(default_factory=dict)
    peer_limit: float = 60.0

    def chosen(self, selection: Selection) -> Iterator[Case]:
        """The cases whose name is wanted."""
        return (case for case in self.cases(selection) if selection.wants(case.name))


class Registry:
    """Families by name, in the order in which they were added."""

    def __init__(self, families: Iterable[Family] = ()) -> None:
        self._families: dict[str, Family] = {}
        for family in families:
            self.add(family)

    def add(self, family: Family) -> None:
        """Add a family.

        Raises
        ------
        BenchmarkError
            If the name is taken.
        """
        if family.name in self._families:
            raise BenchmarkError(f"family: {family.name!r} is there already, expected a new name")
        self._families[family.name] = family

    def __getitem__(self, name: str) -> Family:
        if name not in self._families:
            raise BenchmarkError(
                f"family: found {name!r}, expected one of " + ", ".join(self._families)
            )
        return self._families[name]

    def __iter__(self) -> Iterator[Family]:
        return iter(self._families.values())

    def __len__(self) -> int:
        return len(self._families)
