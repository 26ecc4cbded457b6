"""Write numbers for people: proved ones rounded in one direction, assumed ones in full."""

from __future__ import annotations

from sparsepop_py.verified.arithmetic import display

__all__ = ["all_digits", "rounded"]


def rounded(value: float, up: bool, digits: int = 8) -> str:
    """Write a number in the given digits, rounded in one direction.

    Parameters
    ----------
    value : float
    up : bool
        Towards plus infinity; otherwise towards minus infinity.
    digits : int

    Examples
    --------
    >>> rounded(2 / 3, True, 3), rounded(2 / 3, False, 3)
    ('0.667', '0.666')
    """
    return display.rounded(value, up, digits)


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
