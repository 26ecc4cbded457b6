"""Read files within limits, and write them whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from sparsepop_py.errors import FormatError, OutputError, ProblemError, shown

__all__ = ["as_path", "can_name_a_file", "read_bytes", "read_text", "write_file", "write_text"]

LARGEST = 2**31  # bytes: what is larger is no problem that anything here can hold


def as_path(path: Any) -> Path:
    """Return a path as a Path.

    Raises
    ------
    FormatError
        If it is neither a string nor path-like, or no file can have this name.
    """
    if not isinstance(path, (str, os.PathLike)) or isinstance(os.fspath(path), bytes):
        raise FormatError(f"path: found {shown(path)}, expected the name of a file")
    if not can_name_a_file(os.fspath(path)):
        raise FormatError(f"path: found {os.fspath(path)!r}, expected the name of a file")
    return Path(path)


def can_name_a_file(name: str) -> bool:
    r"""Check that a file may have a name on this system.

    Parameters
    ----------
    name : str

    Examples
    --------
    >>> can_name_a_file("a.json"), can_name_a_file(""), can_name_a_file("a\0b")
    (True, False, False)
    """
    try:
        return bool(name) and b"\0" not in os.fsencode(name)
    except UnicodeEncodeError:
        return False


def read_bytes(path: Any) -> bytes:
    """Read a whole file.

    Raises
    ------
    FormatError
        If ``path`` is no path, the file cannot be read, or is larger than 2 GiB.
    """
    source = as_path(path)
    try:
        with open(source, "rb") as file:
            found = file.read(LARGEST + 1)
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file") from error
    except (OSError, MemoryError) as error:
        raise FormatError(f"{path}: {getattr(error, 'strerror', '') or error}") from error
    if len(found) > LARGEST:
        raise FormatError(f"{path}: found more than {LARGEST} bytes, expected fewer")
    return found


def read_text(path: Any, errors: str = "strict") -> str:
    """Read a whole file of UTF-8 text, with all kinds of line ends.

    Parameters
    ----------
    path : str or PathLike
    errors : {"strict", "replace"}
        What to do with bytes that are no UTF-8.

    Raises
    ------
    FormatError
        If ``path`` is no path, or the file cannot be read, is larger than 2 GiB or no UTF-8.
    """
    try:
        text = read_bytes(path).decode("utf-8", errors)
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: {error}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def write_file(path: Any, write: Callable[[BinaryIO], object]) -> None:
    """Write a file whole or not at all; the old one stays until then.

    The content goes to a file beside it that takes its place at the end. What is no regular
    file, such as a terminal, is written directly.

    Parameters
    ----------
    path : str or PathLike
    write : callable
        Given a binary file that is open for writing, writes the content.

    Raises
    ------
    FormatError
        If ``path`` is no path.
    OutputError
        If the file cannot be written.

    Examples
    --------
    >>> write_file("letters.bin", lambda file: file.write(b"abc"))
    >>> read_bytes("letters.bin")
    b'abc'
    """
    target = as_path(path)
    try:
        target = Path(os.path.realpath(target))  # a link stays a link
        if target.exists() and not target.is_file():
            with open(target, "wb") as file:
                write(file)
            return
        beside = target.with_name(f".{secrets.token_hex(8)}.tmp")
        try:
            with open(beside, "xb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            if target.exists():
                os.chmod(beside, target.stat().st_mode & 0o7777)
            os.replace(beside, target)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_text(path: Any, text: str, encoding: str = "utf-8") -> None:
    """Write a text file whole or not at all, with its own line ends.

    Parameters
    ----------
    path : str or PathLike
    text : str
    encoding : str

    Raises
    ------
    FormatError
        If ``path`` is no path.
    ProblemError
        If the encoding does not hold the text.
    OutputError
        If the file cannot be written.
    """
    try:
        content = text.encode(encoding)
    except UnicodeEncodeError as error:
        raise ProblemError(f"{path}: {error}") from error
    write_file(path, lambda file: file.write(content))
