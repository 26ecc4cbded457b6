"""Workers of an executor that examine cones together, for searches over cones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any, TypeVar

from sparsepop_py.errors import SparsePOPError
from sparsepop_py.executors.dispatch import map_in_order, workers_of

__all__ = ["MOST_BYTES", "Crew"]

T = TypeVar("T")
MOST_BYTES = 2.0**29  # bytes of multipliers
_CONES_PER_WORKER = 4  # cones for each worker of an executor


class Crew:
    """Workers that examine cones, until their executor takes no tasks any more. Mutable.

    Parameters
    ----------
    executor : concurrent.futures.Executor or None
        None: this process alone.

    Attributes
    ----------
    cones : int
        How many are examined together.
    """

    def __init__(self, executor: Executor | None) -> None:
        self._executor = executor
        self.cones = _CONES_PER_WORKER * workers_of(executor) or 1

    def map(self, work: Callable[[Any], T], tasks: Sequence[Any]) -> list[T]:
        """Do work on tasks; results come in their order."""
        try:
            return map_in_order(self._executor, work, tasks)
        except SparsePOPError:  # the executor takes no tasks any more
            self._executor, self.cones = None, 1
            return [work(task) for task in tasks]
