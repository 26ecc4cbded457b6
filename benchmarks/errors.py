"""What is wrong with the input of a measurement, and how defects of what is measured show."""

from __future__ import annotations

import sparsepop_py as sp

__all__ = ["DEFECTS", "BenchmarkError"]

DEFECTS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
    sp.SparsePOPError,
)


class BenchmarkError(ValueError):
    """An argument or a line of results is malformed.

    The message names the field, what was found and what was expected.
    """
