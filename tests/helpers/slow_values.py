"""Values of parameters that are tried with the slow tests alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def slow_after(count: int, values: Iterable[Any]) -> list[Any]:
    """Mark all values slow but the first ``count``."""
    given = list(values)
    return [*given[:count], *(pytest.param(v, marks=pytest.mark.slow) for v in given[count:])]


def slow_unless(fast: Callable[..., bool], values: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Mark the tuples of values slow that ``fast`` refuses."""
    return [v if fast(*v) else pytest.param(*v, marks=pytest.mark.slow) for v in values]
