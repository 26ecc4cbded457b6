"""Share settings, limits and seconds of stages among the methods of one identification."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from setid.formulation.formulation import Formulation
from setid.options import Options
from setid.proofs.intervals import ParameterInterval
from setid.result.assembling import (
    Outcome,
    empty_result,
    result_of,
)
from setid.result.identification import Identification
from setid.result.progress import OnProgress
from sparsepop_py.budget import EARLY, Deadline, cpu_seconds

__all__ = ["BoundingContext"]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class BoundingContext:
    """Settings and limits of one identification, with what its stages took.

    Parameters
    ----------
    settings : Options
    deadline : Deadline
        Of the stage, or a part of that of the whole.
    timings : dict of str to float
        CPU seconds by stage; the stages add to it.
    on_progress : callable, optional
        Called with new bounds, as by :func:`setid.identify`.
    known : mapping of str to float, optional
        Parameters that are consistent, where a search came before all stages.
    """

    settings: Options
    deadline: Deadline
    timings: dict[str, float]
    on_progress: OnProgress | None = None
    known: Mapping[str, float] | None = None

    @property
    def until(self) -> float:
        """The reading of ``time.monotonic`` at which work ends, as it is expected now."""
        return self.deadline.end

    @property
    def left(self) -> float:
        """Seconds until then."""
        return self.until - time.monotonic()

    def timed(self, stage: str, work: Callable[[], Any]) -> Any:
        """Do some work and add its CPU seconds to its stage.

        Parameters
        ----------
        stage : str
        work : callable
        """
        begin = cpu_seconds()
        try:
            return work()
        finally:
            spent = cpu_seconds() - begin
            self.timings[stage] = self.timings.get(stage, 0.0) + spent
            _LOG.debug("%s: %.3f CPU seconds", stage, spent)

    def kept(self, stage: str, work: Callable[[], Any], otherwise: Any) -> Any:
        """Do timed work within the limits.

        Parameters
        ----------
        stage : str
        work : callable
        otherwise : object
            Returned where time is over, or ends before the work does.
        """
        if self.deadline.stopped:
            return otherwise
        try:
            with self.deadline.kept():
                return self.timed(stage, work)
        except EARLY as cause:
            self.deadline.ended(cause)
            return otherwise

    def empty(self, formulation: Formulation, outcome: Outcome) -> Identification:
        """Put an empty result together.

        Parameters
        ----------
        formulation : Formulation
        outcome : Outcome
        """
        return empty_result(formulation, self.settings, self.timings, outcome)

    def result(
        self, formulation: Formulation, items: Sequence[ParameterInterval], outcome: Outcome
    ) -> Identification:
        """Put a result together.

        Parameters
        ----------
        formulation : Formulation
        items : sequence of ParameterInterval
            One a parameter, in their order.
        outcome : Outcome
        """
        return result_of(formulation, self.settings, self.timings, items, outcome)
