"""Options from the command line, and variants with one switch off."""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import sparsepop_py as sp
from sparsepop_py.options import SKIPPED

from ..errors import BenchmarkError

__all__ = ["options_from", "parsed", "switches", "variants"]


def parsed(texts: Iterable[str]) -> dict[str, Any]:
    """Settings from texts such as ``"order=2"`` or ``"effort=plain"``.

    Raises
    ------
    BenchmarkError
        If a text has no "=".

    Examples
    --------
    >>> parsed(["order=2", "effort=plain"])
    {'order': 2, 'effort': 'plain'}
    """
    found = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise BenchmarkError(f"setting: found {text!r}, expected field=value")
        found[name.strip()] = _value(value.strip())
    return found


def _value(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def options_from(settings: Mapping[str, Any]) -> sp.Options:
    """Options with these fields.

    Raises
    ------
    BenchmarkError
        If there is no such field; the message names it.
    ProblemError
        If its value is out of range.
    """
    names = {f.name for f in dataclasses.fields(sp.Options)}
    unknown = [name for name in settings if name not in names]
    if unknown:
        known = ", ".join(sorted(names))
        raise BenchmarkError(f"Options.{unknown[0]}: no such field, expected one of {known}")
    return sp.Options(**settings)


def switches() -> tuple[str, ...]:
    """What can be switched off: sparsity, and the parts of effort "auto".

    Examples
    --------
    >>> "sparse" in switches(), "star" in switches()
    (True, True)
    """
    return ("sparse", *SKIPPED)


def variants(
    settings: Mapping[str, Any], names: Iterable[str], more: Iterable[str] = ()
) -> dict[str, dict[str, Any]]:
    """Settings by name: the default, each switch off in turn, and variants given as texts.

    Parameters
    ----------
    settings : mapping
        What all variants share.
    names : iterable of str
        Switches, as :func:`switches` lists them.
    more : iterable of str
        Such as ``"plain:effort=plain,refine=none"``.

    Raises
    ------
    BenchmarkError
        If a switch is unknown or a text is malformed.
    """
    found: dict[str, dict[str, Any]] = {"default": dict(settings)}
    known = switches()
    for name in names:
        if name not in known:
            raise BenchmarkError(f"--switches: found {name!r}, expected one of {', '.join(known)}")
        change = {"sparse": False} if name == "sparse" else {"skip": (name,)}
        found[f"no {name}"] = {**settings, **change}
    for text in more:
        name, colon, rest = text.partition(":")
        if not colon or not name or name in found:
            raise BenchmarkError(
                f"--variant: found {text!r}, expected NEW-NAME:field=value,field=value"
            )
        found[name] = {**settings, **parsed(rest.split(","))}
    for each in found.values():
        options_from(each)  # wrong fields are found before anything is measured
    return found
