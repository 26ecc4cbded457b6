"""Options from the command line, and variants with one switch off."""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import sparsepop_py as sp

from .errors import BenchmarkError

__all__ = ["options_from", "parsed", "switches", "variants"]

_NO_SWITCHES = ("progress",)


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
    """Options with these fields; a name with dots leads into a field that is a dataclass.

    Raises
    ------
    BenchmarkError
        If there is no such field; the message names it.
    ProblemError
        If its value is out of range.
    """
    names = {f.name for f in dataclasses.fields(sp.Options)}
    unknown = [name for name in settings if name.split(".")[0] not in names]
    if unknown:
        known = ", ".join(sorted(names))
        raise BenchmarkError(f"Options.{unknown[0]}: no such field, expected one of {known}")
    options = sp.Options(**{name: v for name, v in settings.items() if "." not in name})
    for name, value in settings.items():
        if "." in name:
            options = _within(options, name.split("."), value, name)
    return options


def _within(thing: Any, path: list[str], value: Any, name: str) -> Any:
    """A copy of nested dataclasses with one field changed."""
    head, rest = path[0], path[1:]
    if not dataclasses.is_dataclass(thing) or not hasattr(thing, head):
        raise BenchmarkError(f"Options.{name}: no such field")
    inner = _within(getattr(thing, head), rest, value, name) if rest else value
    return dataclasses.replace(thing, **{head: inner})  # type: ignore[type-var]


def switches(options: Any = None, prefix: str = "") -> Iterator[str]:
    """Names of the fields, nested ones with dots, that are True and can be switched off.

    Examples
    --------
    >>> "sparse" in switches()
    True
    """
    thing = sp.Options() if options is None else options
    for f in dataclasses.fields(thing):
        value = getattr(thing, f.name)
        if value is True and f.name not in _NO_SWITCHES:
            yield prefix + f.name
        elif dataclasses.is_dataclass(value):
            yield from switches(value, f"{prefix}{f.name}.")


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
    known = list(switches())
    for name in names:
        if name not in known:
            raise BenchmarkError(f"--switches: found {name!r}, expected one of {', '.join(known)}")
        found[f"no {name}"] = {**settings, name: False}
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
