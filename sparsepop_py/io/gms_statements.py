"""The statements of a GAMS file, each with the line where it begins.

Comments (``*`` in column one, also inside a statement), ``$ontext`` blocks and other
lines that begin with ``$`` are taken off here; line numbers stay those of the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sparsepop_py.errors import FormatError
from sparsepop_py.io.expressions import excerpt

__all__ = ["Statement", "read_statements"]

_SOLVE_COMMENT = re.compile(
    r"\*\s*(solve\b.*\busing\b.*\b(?:mini|maxi)mi[sz]ing\s+[a-z]\w*)", re.IGNORECASE
)
_INCLUDE = re.compile(r"\$(?:bat|lib|sys)?include\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement without its semicolon.

    Parameters
    ----------
    path : str
        The file, used in messages.
    text : str
    line : int
        Line of the first character, from 1.
    """

    path: str
    text: str
    line: int

    def error(self, found: str, expected: str, position: int = 0) -> FormatError:
        """Exception that names file, line and statement; raise it."""
        line = self.line + self.text.count("\n", 0, position)
        shown = excerpt(self.text, position)
        return FormatError(
            f"{self.path}:{line}: statement {shown}: found {found}, expected {expected}"
        )


def read_statements(path: str | os.PathLike[str]) -> tuple[list[Statement], list[Statement]]:
    """Read a file.

    Returns
    -------
    statements : list of Statement
        In the order of the file; at least one.
    directions : list of Statement
        Comments such as ``Solve m using NLP maximizing objvar``: files made for
        SparsePOP may say only there whether they minimise.

    Raises
    ------
    FormatError
        If there is no such file, if it is empty, or if its last statement does not end.
    """
    text = _read(path)
    lines, comments = _without_comments(str(path), text)
    directions = [
        Statement(str(path), match.group(1), number)
        for number, comment in comments
        if (match := _SOLVE_COMMENT.match(comment))
    ]
    statements = list(_split(str(path), "\n".join(lines)))
    if not statements:
        raise Statement(str(path), "", 1).error("no statement", "'Variables ...;'")
    return statements, directions


def _read(path: str | os.PathLike[str]) -> str:
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file") from error
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror or error}") from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # accents in old comments
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _without_comments(path: str, text: str) -> tuple[list[str], list[tuple[int, str]]]:
    """Lines with comments blanked, and the comments with their line numbers."""
    lines: list[str] = []
    comments: list[tuple[int, str]] = []
    block = 0  # line of the $ontext that is open
    for number, line in enumerate(text.split("\n"), 1):
        control = line[:8].lower() if line.startswith("$") else ""
        if control == "$ontext":
            block = number
        elif control == "$offtext":
            block = 0
        elif _INCLUDE.match(line) and not block:
            raise Statement(path, line, number).error(
                "an included file", "one file that holds the whole problem"
            )
        elif line.startswith("*") and not block:
            comments.append((number, line))
        blank = block or line.startswith(("*", "$"))
        lines.append("" if blank else line)
    if block:
        raise Statement(path, "$ontext", block).error("no $offtext", "one after $ontext")
    return lines, comments


def _split(path: str, text: str) -> Iterator[Statement]:
    line, start = 1, 0
    for end in [*(match.start() for match in re.finditer(";", text)), len(text)]:
        piece = text[start:end]
        stripped = piece.lstrip()
        begin = line + piece[: len(piece) - len(stripped)].count("\n")
        if stripped:
            statement = Statement(path, stripped.rstrip(), begin)
            if end == len(text):
                raise statement.error("the end of the file", "';' after the last statement")
            yield statement
        line += piece.count("\n")
        start = end + 1
