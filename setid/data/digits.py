"""Write assumptions for people: numbers in full."""

from __future__ import annotations

__all__ = ["all_digits"]


def all_digits(value: float) -> str:
    """Write a number with all its digits: an assumption that is rounded is another one.

    Parameters
    ----------
    value : float

    Examples
    --------
    >>> all_digits(2 / 3), all_digits(3.0)
    ('0.6666666666666666', '3')
    """
    return repr(float(value)).removesuffix(".0")
