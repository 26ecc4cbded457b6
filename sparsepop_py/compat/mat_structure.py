"""Check the structure of a MAT file of version 5 before SciPy reads it.

SciPy's reader trusts types and sizes: a damaged file ends the process, and a small compressed
one may fill the memory. Here every element is walked without making anything of it, and what
SciPy relies on is checked.

References
----------
The MathWorks, MAT-File Format, 2024: level 5, chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from math import prod

import numpy as np

from sparsepop_py.errors import FormatError

__all__ = ["check_structure"]

LARGEST = 2**30  # bytes after decompression
MOST_ARRAYS = 10**7
DEEPEST = 50  # arrays in cells and structs

_MATRIX, _COMPRESSED = 14, 15
_INT8, _INT32, _UINT32, _UTF8 = 1, 5, 6, 16
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
_LETTERS = {1: "ascii", 2: "ascii", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE = 1, 2, 3, 4, 5
_NUMBERS = range(6, 16)
_CLASSES = range(1, 16)  # 16 and 17 are function handles and objects of classes
_COMPLEX, _LOGICAL = 0x800, 0x200


def check_structure(data: bytes) -> None:
    """Walk through a file of version 5; other versions are left to their readers.

    Parameters
    ----------
    data : bytes
        The whole file.

    Raises
    ------
    FormatError
        Naming the byte, what was found there and what was expected.
    """
    if 0 in data[:4] or (len(data) >= 128 and data[126:128] not in (b"IM", b"MI")):
        return  # version 4, or no MAT file: Python code reads them
    if len(data) < 128:
        raise FormatError(f"found {len(data)} bytes, expected a header of 128")
    order = "<" if data[126:128] == b"IM" else ">"
    if struct.unpack_from(order + "H", data, 124)[0] >> 8 != 1:
        return  # version 7.3 is HDF5, which SciPy refuses
    walk = _Walk(data, order)
    at = 128
    while at < len(data):
        at = walk.variable(at)


@dataclass
class _Walk:
    """A place where elements follow each other, and what was met so far."""

    data: bytes
    order: str
    offset: str = "byte"
    expanded: list[int] = field(default_factory=lambda: [0])
    arrays: list[int] = field(default_factory=lambda: [0])

    def wrong(self, at: int, found: object, expected: str) -> FormatError:
        return FormatError(f"{self.offset} {at}: found {found}, expected {expected}")

    def variable(self, at: int) -> int:
        """Check an element of the file; where the next one starts."""
        kind, start, size, following = self.tag(at, len(self.data), padded=False)
        if kind == _MATRIX:
            self.array(start, start + size, 0, named=True)
        elif kind == _COMPRESSED:
            self.inside(start, size)
        else:
            raise self.wrong(at, f"type {kind}", "an array")
        return following

    def inside(self, at: int, size: int) -> None:
        """Check what a compressed element holds."""
        room = LARGEST - self.expanded[0]
        machine = zlib.decompressobj()
        try:
            inner = machine.decompress(self.data[at : at + size], room + 1)
        except zlib.error as error:
            raise self.wrong(at, f"damaged compressed data ({error})", "zlib's format") from None
        if len(inner) > room:
            raise self.wrong(at, f"more than {LARGEST} bytes after decompression", "fewer")
        if not machine.eof:
            raise self.wrong(at, "the end of compressed data", "its last block")
        self.expanded[0] += len(inner)
        walk = _Walk(inner, self.order, "decompressed byte", self.expanded, self.arrays)
        kind, start, length, following = walk.tag(0, len(inner))
        if kind != _MATRIX or following < len(inner):
            raise walk.wrong(0, f"type {kind} of {length} bytes", f"an array of {len(inner) - 8}")
        walk.array(start, start + length, 0, named=True)

    def tag(self, at: int, end: int, padded: bool = True) -> tuple[int, int, int, int]:
        """Read type, start and size of an element, and the start of the next one."""
        if at + 8 > end:
            raise self.wrong(at, f"{end - at} bytes", "a tag of 8")
        kind, size = struct.unpack_from(self.order + "II", self.data, at)
        if kind >> 16:  # type, size and data in one tag
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise self.wrong(at, f"{size} bytes in a small element", "at most 4")
            return kind, at + 4, size, at + 8
        following = at + 8 + size
        if following > end:
            raise self.wrong(at, f"an element of {size} bytes", f"at most {end - at - 8}")
        if padded and kind != _MATRIX:
            following = min(end, following + -size % 8)
        return kind, at + 8, size, following

    def array(self, at: int, end: int, depth: int, named: bool = False) -> None:
        """Check an array: flags, dimensions, name, and what its class asks for."""
        self.arrays[0] += 1
        if depth > DEEPEST or self.arrays[0] > MOST_ARRAYS:
            raise self.wrong(at, "more arrays", f"at most {MOST_ARRAYS}, {DEEPEST} in each other")
        if at == end and not named:
            return  # an empty cell or field
        flags, at = self.integers(at, end, (_UINT32,), "flags")
        if flags.size != 2:
            raise self.wrong(at, f"{flags.size} flags", "two")
        marks = int(flags[0])
        kind = marks & 0xFF
        if kind not in _CLASSES:
            raise self.wrong(at, f"an array of class {kind}", "numbers, text, cells or structs")
        sizes, at = self.integers(at, end, (_INT32, _UINT32), "dimensions")
        if not 2 <= sizes.size <= 32 or np.any(sizes < 0):
            raise self.wrong(at, f"dimensions {sizes.tolist()[:8]}", "2 to 32, none negative")
        _, at = self.name(at, end)
        at = self.content(at, end, kind, sizes.tolist(), (depth, marks))
        if at != end:
            raise self.wrong(at, f"{end - at} bytes more", "the end of the array")

    def content(self, at: int, end: int, kind: int, sizes: list[int], more: tuple[int, int]) -> int:
        """Check what follows the name of an array of a class; where it ends."""
        count, (depth, marks) = prod(sizes), more
        if kind in _NUMBERS:
            for _ in range(2 if marks & _COMPLEX else 1):
                at = self.values(at, end, count)
            return at
        if kind == _CHAR:
            return self.letters(at, end, count)
        if kind == _CELL:
            return self.nested(at, end, count, depth)
        if kind in (_STRUCT, _OBJECT):
            if kind == _OBJECT:
                _, at = self.name(at, end)
            fields, at = self.fields(at, end)
            return self.nested(at, end, count * fields, depth)
        return self.sparse(at, end, sizes, marks)

    def integers(
        self, at: int, end: int, kinds: tuple[int, ...], what: str
    ) -> tuple[np.ndarray, int]:
        """Read integers of 4 bytes; return them with the start of the next element."""
        found, start, size, following = self.tag(at, end)
        if found not in kinds or size % 4:
            raise self.wrong(at, f"type {found} of {size} bytes", f"{what} of type {kinds[0]}")
        code = self.order + ("u4" if kinds[0] == _UINT32 else "i4")
        return np.frombuffer(self.data, code, size // 4, start).astype(np.int64), following

    def name(self, at: int, end: int) -> tuple[bytes, int]:
        """Read a name in plain letters; return it with the start of the next element."""
        kind, start, size, following = self.tag(at, end)
        found = self.data[start : start + size]
        if kind not in (_INT8, _UTF8) or not found.isascii():
            raise self.wrong(at, f"type {kind} {found[:20]!r}", "a name")
        return found, following

    def values(self, at: int, end: int, count: int) -> int:
        kind, _, size, following = self.tag(at, end)
        if kind not in _WIDTHS or size != count * _WIDTHS[kind]:
            raise self.wrong(at, f"type {kind} of {size} bytes", f"{count} numbers")
        return following

    def letters(self, at: int, end: int, count: int) -> int:
        kind, start, size, following = self.tag(at, end)
        codec = _LETTERS.get(kind, "")
        if codec[-2:] in ("16", "32"):
            codec += "-le" if self.order == "<" else "-be"
        try:
            length = len(self.data[start : start + size].decode(codec or "ascii"))
        except UnicodeDecodeError:
            length = -1
        if not codec or (size and length != count):
            raise self.wrong(at, f"type {kind} of {size} bytes", f"{count} letters")
        return following

    def nested(self, at: int, end: int, count: int, depth: int) -> int:
        if 8 * count > end - at:
            raise self.wrong(at, f"{end - at} bytes", f"{count} arrays")
        for _ in range(count):
            kind, start, size, following = self.tag(at, end)
            if kind != _MATRIX:
                raise self.wrong(at, f"type {kind}", "an array")
            self.array(start, start + size, depth + 1)
            at = following
        return at

    def fields(self, at: int, end: int) -> tuple[int, int]:
        """Read the number of fields of a struct, and the next element's start."""
        width, at = self.integers(at, end, (_INT32,), "the length of names")
        names, following = self.name(at, end)
        if width.size != 1 or width[0] < 1 or len(names) % int(width[0]):
            raise self.wrong(at, f"{len(names)} bytes of names", f"names of {width.tolist()}")
        return len(names) // int(width[0]), following

    def sparse(self, at: int, end: int, sizes: list[int], marks: int) -> int:
        """Read rows, starts of columns and values; indices lie within the matrix."""
        start = at
        rows, at = self.integers(at, end, (_INT32,), "rows")
        starts, at = self.integers(at, end, (_INT32,), "starts of columns")
        count = int(starts[-1]) if starts.size else -1
        if len(sizes) != 2 or starts.size != sizes[1] + 1 or not 0 <= count <= rows.size:
            raise self.wrong(start, f"{starts.size} starts of columns", f"those of {sizes}")
        used = rows[:count]
        if starts[0] or np.any(np.diff(starts) < 0) or np.any((used < 0) | (used >= sizes[0])):
            raise self.wrong(start, "indices outside the matrix", f"some within {sizes}")
        for _ in range(2 if marks & _COMPLEX else 1):
            kind, _, size, following = self.tag(at, end)
            width = 1 if marks & _LOGICAL and size == count else _WIDTHS.get(kind, 0)
            if not width or size % width or not count <= size // width <= max(rows.size, 1):
                raise self.wrong(at, f"type {kind} of {size} bytes", f"{count} numbers")
            at = following
        return at
