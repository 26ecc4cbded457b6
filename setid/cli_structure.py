"""The structure that a command line asks for, in discrete or in continuous time."""

from __future__ import annotations

import argparse
from typing import Literal, get_args

from setid.data.record import IOData
from setid.errors import ModelError
from setid.models.continuous import ContinuousTransferFunction, Hold, Method
from setid.models.equations import Initial, Structure
from setid.models.lti import TransferFunction

__all__ = ["add_structure", "structure_from"]

_DISCRETE = ("na", "nb", "nk")
_CONTINUOUS = ("method", "delta", "tau", "hold")


def add_structure(command: argparse.ArgumentParser) -> None:
    """The options that describe structures and priors."""
    group = command.add_argument_group("structure and priors")
    group.add_argument("--na", type=int, help="denominator coefficients")
    group.add_argument("--nb", type=int, help="numerator coefficients")
    group.add_argument("--nk", type=int, help="delay in samples (0)")
    group.add_argument("--offset", action="store_true", help="an unknown constant")
    group.add_argument(
        "--common-denominator", action="store_true", help="one for all pairs of channels"
    )
    group.add_argument("--from-rest", action="store_true", help="zero before the record")
    group.add_argument("--stable", action="store_true", help="no poles outside the stable region")
    group.add_argument("--dc-gain", type=float, nargs=2, metavar=("LOW", "HIGH"))
    group = command.add_argument_group("continuous time, instead of --na, --nb and --nk")
    group.add_argument(
        "--continuous",
        type=int,
        nargs=2,
        metavar=("N", "M"),
        help="order and degree of the numerator: intervals of a1, a0, b0, ... in powers of s",
    )
    group.add_argument("--method", choices=get_args(Method), help="for derivatives (tustin)")
    group.add_argument(
        "--delta", metavar="BOUND", help="of the discretisation error, or: estimate (0)"
    )
    group.add_argument("--tau", type=float, help="time constant of the method lambda")
    group.add_argument("--hold", choices=get_args(Hold), help="inputs between samples (linear)")


def structure_from(arguments: argparse.Namespace, data: IOData) -> Structure:
    """The structure of parsed options, for the channels of a record.

    Raises
    ------
    ModelError
        If options of discrete and continuous time are mixed, or orders are missing.
    """
    initial: Initial = "zero" if arguments.from_rest else "free"
    continuous = arguments.continuous is not None
    for name in _DISCRETE if continuous else _CONTINUOUS:
        if getattr(arguments, name) is not None:
            where = "without" if continuous else "with"
            raise ModelError(f"--{name}: found a value, expected it {where} --continuous")
    if continuous:
        if arguments.common_denominator:
            raise ModelError("--common-denominator: found it, expected it without --continuous")
        n, m = arguments.continuous
        return ContinuousTransferFunction(
            n,
            m,
            method=arguments.method or "tustin",
            delta=_delta(arguments.delta),
            tau=arguments.tau,
            hold=arguments.hold or "linear",
            initial=initial,
            offset=arguments.offset,
        )
    for name in ("na", "nb"):
        if getattr(arguments, name) is None:
            raise ModelError(f"--{name}: found none, expected orders, or --continuous N M")
    return TransferFunction(
        arguments.na,
        arguments.nb,
        arguments.nk or 0,
        data.inputs,
        data.outputs,
        common_denominator=arguments.common_denominator,
        offset=arguments.offset,
        initial=initial,
    )


def _delta(given: str | None) -> float | Literal["estimate"]:
    if given == "estimate":
        return "estimate"
    try:
        return float(given or 0.0)
    except ValueError:
        raise ModelError(f"--delta: found {given!r}, expected a number or estimate") from None
