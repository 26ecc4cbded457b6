"""Numbers for people that stay true: bounds are rounded outwards, never to nearest."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from numbers import Real

from sparsepop_py.errors import ProblemError, check_switch, check_whole

__all__ = ["rounded"]


def rounded(value: float, upwards: bool, digits: int = 10, scientific: bool = False) -> str:
    """Format a bound in few digits, rounded outwards, so that the text is proved too.

    A lower bound is rounded down and an upper bound up: what the text says is weaker than the
    value, never stronger.

    Parameters
    ----------
    value : float
    upwards : bool
        True for upper bounds, False for lower bounds.
    digits : int
        Significant digits, 1 to 15; 10 when left out.
    scientific : bool
        With sign and exponent, for columns; by default in the shortest form.

    Returns
    -------
    str

    Raises
    ------
    ProblemError
        If the value is no double, such as a fraction, or the digits are out of range.

    Examples
    --------
    >>> rounded(1.26, False, 2, scientific=True), rounded(1.21, True, 2, scientific=True)
    ('+1.2e+00', '+1.3e+00')
    >>> rounded(-0.50000001, upwards=False, digits=7)
    '-0.5000001'
    """
    if not isinstance(value, Real) or not _is_double(value):
        raise ProblemError(f"value: found {value!r:.60}, expected a number that is a double")
    digits = check_whole(digits, "digits", 1, 15)
    check_switch(upwards, "upwards")
    check_switch(scientific, "scientific")
    value = float(value)
    form = f"+.{digits - 1}e" if scientific else f".{digits}g"
    if not math.isfinite(value):
        return format(value, form)
    direction = ROUND_CEILING if upwards else ROUND_FLOOR
    shown = float(Context(prec=digits, rounding=direction).create_decimal_from_float(value))
    outwards = math.inf if upwards else -math.inf
    while _inside(format(shown, form), value, upwards):  # subnormal numbers have few digits
        shown = math.nextafter(shown, outwards)
    return format(shown, form)


def _is_double(value: Real) -> bool:
    """Check that nothing is lost when the value becomes a double."""
    try:
        return bool(value != value or float(value) == value)
    except OverflowError:
        return False


def _inside(text: str, value: float, upwards: bool) -> bool:
    """Check that the text shown lies on the wrong side of the value."""
    return Decimal(text) < Decimal(value) if upwards else Decimal(text) > Decimal(value)
