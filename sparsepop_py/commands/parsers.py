"""Parsers of single commands, alike in both packages."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

__all__ = ["add_command"]


def add_command(
    commands: Any,
    name: str,
    text: str,
    run: Callable[[argparse.Namespace], int] | None = None,
    codes: str | None = None,
) -> argparse.ArgumentParser:
    """Add a command with its help.

    Parameters
    ----------
    commands : argparse subparsers
    name : str
    text : str
        One line of help, without a full stop.
    run : callable, optional
        Takes the arguments and returns the exit code; left out where commands follow.
    codes : str, optional
        The exit codes, shown below the help as they are.

    Returns
    -------
    argparse.ArgumentParser
    """
    command = commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}.",
        epilog=codes,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    assert isinstance(command, argparse.ArgumentParser)
    if run is not None:
        command.set_defaults(run=run)
    return command
