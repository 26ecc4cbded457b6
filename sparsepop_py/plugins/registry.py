"""Name what can be plugged in: conic solvers, file formats, shapes of relaxations.

A registry maps names to objects, or to the place ``"module:attribute"`` where one is found, so
that naming a solver loads it and nothing else. To add one, write one file and one line: an entry
in the table that ends the module of the registry, or a call of :meth:`Registry.register`.

Only producers are plugged in. The steps and arguments that the verifier accepts are a closed set
(:mod:`sparsepop_py.verified`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar

from sparsepop_py.budget import LimitReached, importing
from sparsepop_py.errors import SparsePOPError

__all__ = ["Registry"]

Entry = TypeVar("Entry")


class Registry(Generic[Entry]):
    """Map names to plugged-in objects, which are loaded when they are first asked for.

    Parameters
    ----------
    kind : str
        The word for one entry in error messages, such as ``"solver"``.
    entries : mapping from str to object or "module:attribute"
    error : type of SparsePOPError
        Raised for unknown names, and for entries that cannot be used.
    of : type, optional
        The class of each entry; by default functions and what else can be called.
    prefix : str
        With which each name begins.
    raised : type of SparsePOPError, optional
        What an exception of an entry becomes; ``error`` when left out.

    Examples
    --------
    >>> from sparsepop_py.plugins.registry import Registry
    >>> roots = Registry("root", {"square": "math:sqrt"})
    >>> roots["square"](9.0)
    3.0
    >>> roots.register("none", lambda x: x)
    >>> sorted(roots)
    ['none', 'square']
    """

    def __init__(
        self,
        kind: str,
        entries: Mapping[str, Entry | str],
        error: type[SparsePOPError] = SparsePOPError,
        of: type | None = None,
        prefix: str = "",
        raised: type[SparsePOPError] | None = None,
    ) -> None:
        self.kind, self._entries, self._error = kind, dict(entries), error
        self._of, self._prefix, self._raised = of, prefix, raised or error
        self._own = frozenset(entries)

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def __getitem__(self, name: str) -> Entry:
        """Look up the object of a name.

        Raises
        ------
        SparsePOPError
            If nothing has the name, or nothing is at the place that was registered; of the kind
            that the registry was made with.
        """
        if name not in self._entries:
            known = ", ".join(self._entries)
            raise self._error(f"{self.kind}: found {name!r}, expected one of {known}")
        entry = self._entries[name]
        if isinstance(entry, str):
            entry = self._entries[name] = self._loaded(name, entry)
        return entry

    def _loaded(self, name: str, place: str) -> Entry:
        module, _, attribute = place.partition(":")
        try:
            with importing():
                entry: Entry = getattr(import_module(module), attribute)
        except (ImportError, AttributeError) as error:
            raise self._error(
                f"{self.kind} {name!r}: found nothing at {place!r}: {error}"
            ) from error
        self._check(name, entry)
        return entry

    def _check(self, name: str, entry: object) -> None:
        if not (callable(entry) if self._of is None else isinstance(entry, self._of)):
            expected = "function" if self._of is None else self._of.__name__
            raise self._error(
                f"{self.kind} {name!r}: found {type(entry).__name__}, expected a {expected}"
            )

    def register(self, name: str, entry: Entry | str) -> None:
        """Add an entry.

        Parameters
        ----------
        name : str
        entry : object, or "module:attribute"

        Raises
        ------
        SparsePOPError
            If the name is taken: a registered solver never changes its meaning. If it is no
            name, or the entry is of another kind.
        """
        if not isinstance(name, str) or not name or not name.startswith(self._prefix):
            begins = f" that begins with {self._prefix!r}" if self._prefix else ""
            raise self._error(f"{self.kind}: found {name!r}, expected a name{begins}")
        if name in self._entries:
            raise self._error(f"{self.kind}: {name!r} is registered already")
        if not isinstance(entry, str):
            self._check(name, entry)
        elif not all(entry.partition(":")):
            raise self._error(f"{self.kind} {name!r}: found {entry!r}, expected 'module:attribute'")
        self._entries[name] = entry

    def plugged(self, name: str) -> bool:
        """Check that an entry was registered from outside.

        Parameters
        ----------
        name : str
        """
        return name in self._entries and name not in self._own

    def ask(self, name: str, function: Callable[..., Any], *given: Any) -> Any:
        """Call a function of an entry; name the entry where it raises.

        Parameters
        ----------
        name : str
            Of the entry.
        function : callable
        given : objects

        Raises
        ------
        SparsePOPError
            If an entry from outside raises an exception, which is its cause. The end of the time
            and interrupts pass.

        Examples
        --------
        >>> from sparsepop_py.plugins.registry import Registry
        >>> roots = Registry("root", {})
        >>> roots.register("inverse", lambda x: 1 / x)
        >>> roots.ask("inverse", roots["inverse"], 2)
        0.5
        """
        if not self.plugged(name):
            return function(*given)
        try:
            return function(*given)
        except LimitReached:
            raise
        except SparsePOPError as error:
            if f"{self.kind} {name!r}" in str(error):
                raise
            raise type(error)(f"{self.kind} {name!r}: {error}") from error
        except Exception as error:  # whatever an entry does wrong
            raise self._raised(
                f"{self.kind} {name!r}: raised {type(error).__name__}: {error}"
            ) from error

    def unregister(self, name: str) -> None:
        """Take an entry out again, as tests do.

        Parameters
        ----------
        name : str
        """
        self._entries.pop(name, None)
