"""Interrupts of the user in the middle of a search: at one of its linear programs."""

from __future__ import annotations

from typing import Any

import pytest

from setid.neural.arithmetic import LinearModel

__all__ = ["InterruptedPrograms"]


class InterruptedPrograms:
    """Linear programs, of which one is interrupted. Mutable.

    ``last`` is its number, from 1, and ``count`` how many were begun.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.last, self.count, usual = 0, 0, LinearModel.solve

        def solve(model: LinearModel, *arguments: Any) -> Any:
            self.count += 1
            if self.count == self.last:
                raise KeyboardInterrupt
            return usual(model, *arguments)

        patch.setattr(LinearModel, "solve", solve)

    def interrupt(self, last: int) -> None:
        """Count from the beginning, up to a program that is interrupted."""
        self.last, self.count = last, 0
