"""What is wrong with the input of a measurement."""

from __future__ import annotations

__all__ = ["BenchmarkError"]


class BenchmarkError(ValueError):
    """An argument or a line of results is malformed.

    The message names the field, what was found and what was expected.
    """
