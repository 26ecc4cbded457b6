"""Send values to other processes, with references in place of objects that are there already.

A value that goes to another process and comes back changed mostly holds much that did not
change. Objects that are *kept* travel once to each process and stand there for those of this
one; in all values, both ways, they are references. So they are the same objects when they come
back, and what was remembered of them holds. Objects that are *live* are sent with each
value, since they change, and are references on the way back: the changes stay there.
"""

from __future__ import annotations

import io
import pickle
import uuid
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["Packet", "Received", "References", "received"]

_OWNERS = 4  # whose objects a process keeps at a time
_LIVE = -1  # in place of the number of a group

Place = tuple[int, int]
_kept: OrderedDict[str, list[tuple[Any, ...]]] = OrderedDict()  # by owner: groups of objects


@dataclass(frozen=True, eq=False)
class Packet:
    """A value on its way to another process.

    Parameters
    ----------
    owner : str
        Name of the :class:`References` that packed it.
    groups : tuple of bytes
        All groups of kept objects; those that are there already are not read.
    live, body : bytes
        Live objects, and the value.
    """

    owner: str
    groups: tuple[bytes, ...]
    live: bytes
    body: bytes


class References:
    """Objects of this process that stay in others. Mutable.

    Examples
    --------
    >>> from sparsepop_py.executors.references import References, received
    >>> references, large, state = References(), [1.0] * 1000, {}
    >>> references.keep(large)
    >>> there = received(references.packed((large, "first"), [state]))
    >>> there.value[0] is large, there.value[1]
    (False, 'first')
    >>> back = references.unpacked(there.answer((there.value[0], "second")), [state])
    >>> back[0] is large, back[1]
    (True, 'second')
    """

    def __init__(self) -> None:
        self._owner = uuid.uuid4().hex
        self._groups: list[bytes] = []
        self._objects: list[tuple[Any, ...]] = []
        self._places: dict[int, Place] = {}

    def keep(self, *objects: Any) -> None:
        """Keep objects in other processes from now on; pickled together, they share parts.

        Parameters
        ----------
        *objects
            They must not change.
        """
        new = tuple(each for each in objects if id(each) not in self._places)
        if new:
            self._groups.append(_dumped(new, self._places))
            self._places |= {id(each): (len(self._objects), k) for k, each in enumerate(new)}
            self._objects.append(new)

    def packed(self, value: Any, live: Sequence[Any] = ()) -> Packet:
        """Pack a value for another process.

        Parameters
        ----------
        value : object
        live : sequence
            Objects that change; the value may hold them, and what is kept does not.
        """
        body = _dumped(value, self._places | _live_places(live))
        return Packet(self._owner, tuple(self._groups), _dumped(list(live), self._places), body)

    def unpacked(self, answer: bytes, live: Sequence[Any] = ()) -> Any:
        """Unpack what another process answered, with the live objects that it was sent."""
        return _loaded(answer, self._objects, live)


@dataclass(frozen=True, eq=False)
class Received:
    """A value that came from another process.

    Parameters
    ----------
    value : object
    live : list
        The live objects as they were when it was sent.
    groups : list of tuple
        The kept objects.
    """

    value: Any
    live: list[Any]
    groups: list[tuple[Any, ...]]

    def answer(self, value: Any) -> bytes:
        """Pickle an answer in which kept and live objects are references."""
        kept = {id(x): (g, k) for g, group in enumerate(self.groups) for k, x in enumerate(group)}
        return _dumped(value, kept | _live_places(self.live))


def received(packet: Packet) -> Received:
    """Unpack a value from another process and keep what it keeps here.

    Parameters
    ----------
    packet : Packet

    Returns
    -------
    Received
    """
    groups = list(_kept.pop(packet.owner, ()))
    for data in packet.groups[len(groups) :]:
        groups.append(_loaded(data, groups, ()))
    _kept[packet.owner] = groups
    while len(_kept) > _OWNERS:
        _kept.popitem(last=False)
    live = _loaded(packet.live, groups, ())
    return Received(_loaded(packet.body, groups, live), live, groups)


def _live_places(live: Sequence[Any]) -> dict[int, Place]:
    return {id(each): (_LIVE, k) for k, each in enumerate(live)}


class _Pickler(pickle.Pickler):
    """Pickles references in place of objects that have a place."""

    def __init__(self, file: io.BytesIO, places: dict[int, Place]) -> None:
        super().__init__(file, 5)
        self._places = places

    def persistent_id(self, obj: Any) -> Place | None:
        """Return the place of an object, None where it has none."""
        return self._places.get(id(obj))


class _Unpickler(pickle.Unpickler):
    """Puts objects in place of references."""

    def __init__(
        self, file: io.BytesIO, groups: Sequence[tuple[Any, ...]], live: Sequence[Any]
    ) -> None:
        super().__init__(file)
        self._groups, self._live = groups, live

    def persistent_load(self, pid: Place) -> Any:
        """Return the object at a place."""
        group, number = pid
        return self._live[number] if group == _LIVE else self._groups[group][number]


def _dumped(value: Any, places: dict[int, Place]) -> bytes:
    file = io.BytesIO()
    _Pickler(file, places).dump(value)
    return file.getvalue()


def _loaded(data: bytes, groups: Sequence[tuple[Any, ...]], live: Sequence[Any]) -> Any:
    return _Unpickler(io.BytesIO(data), groups, live).load()
