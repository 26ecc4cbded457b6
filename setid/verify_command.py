"""The command ``setid verify``: check a stored identification again, without any solver."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.data.tables import column_names, read_table
from setid.errors import DataError, SetidError
from setid.proofs.verification import verify
from setid.result.certificate_files import certificate_files
from setid.result.identification import Identification
from setid.result.json_ import from_json
from sparsepop_py.commands.parsers import add_command
from sparsepop_py.files import read_text
from sparsepop_py.io.json_files.codecs import parsed

__all__ = ["add_verify", "part_of"]

_TEXT = "check a stored identification again, without any solver"
_CODES = """exit codes:
  0  every claim in the file is proved
  1  a claim does not follow, and why
  2  the input is wrong (the message is on standard error)

The program checker/ of the source distribution checks files of --certificate as well, as
  python checker/check.py --record RECORD.csv FILE.json
and takes the same options. It shares no code.
"""


def add_verify(commands: Any) -> None:
    """Add the command to a command line.

    Parameters
    ----------
    commands : argparse subparsers
    """
    command = add_command(commands, "verify", _TEXT, _run, _CODES)
    command.add_argument(
        "file",
        metavar="FILE.json",
        help="of setid identify --certificate, or of Identification.to_json",
    )
    command.add_argument(
        "--record",
        metavar="RECORD.csv",
        help="the table of samples that it should be about, with columns as in the file",
    )
    command.add_argument("--decimal", choices=(".", ","), default=".", help="its decimal mark (.)")
    command.add_argument("--header", type=int, metavar="LINES", help="2: names, then units")
    command.add_argument("--rows", metavar="FIRST:END", help="the part that was identified")


def part_of(given: str, samples: int) -> tuple[int, int]:
    """Read the range FIRST:END of samples, numbered from 0; END is the one behind the last.

    Either may be left out, and counts from the end where it is negative, as in Python.

    Raises
    ------
    DataError
        If the text says no range, or one that holds no sample or leaves the record.
    """
    try:
        first, end = (int(text) if text else None for text in given.split(":"))
    except ValueError:
        raise DataError(f"--rows: found {given!r}, expected FIRST:END") from None
    begin, stop, _ = slice(first, end).indices(samples)
    if begin >= stop or any(abs(row) > samples for row in (first or 0, end or 0)):
        raise DataError(f"--rows: found {given!r}, expected FIRST < END <= {samples}, the samples")
    return begin, stop


def _run(arguments: argparse.Namespace) -> int:
    if arguments.rows is not None and arguments.record is None:
        raise SetidError("--rows: found it alone, expected --record as well, whose part it is")
    result = _read(arguments.file)
    data = None
    if arguments.record is not None:
        data = _record(arguments, result.formulation.data)
    verdict = verify(result.evidence, data)
    if not verdict.ok:
        print(f"NOT PROVED  {verdict.reason}{_other_length(data, result.formulation.data)}")
        return 1
    print("\n".join(_rests_on(result)))
    print(result.table())
    print("proved: outer and inner ends follow from the record, without any solver")
    return 0


def _other_length(data: IOData | None, stored: IOData) -> str:
    """Say how many samples a record has more or fewer than the stored one, if any."""
    if data is None or data.samples == stored.samples:
        return ""
    return (
        f": found {data.samples} samples, expected {stored.samples}; "
        "--rows FIRST:END says which part was identified"
    )


def _rests_on(result: Identification) -> list[str]:
    """List noise bounds, structure and priors; a text of a file cannot look like a verdict."""
    data, lines = result.formulation.data, list[str]()
    for kind, bounds in zip(
        ("output", "input", "equation"), result.formulation.noise.bounds(data), strict=True
    ):
        for channel, column in enumerate(bounds.T.tolist(), 1):
            if any(column):
                ends = dict.fromkeys(repr(v) for v in (min(column), max(column)))
                lines.append(f"noise: |{kind} {channel}| <= {' .. '.join(ends)}")
    texts = (t if t.isprintable() else repr(t) for t in result.formulation.assumptions)
    return [*lines, *(f"assumed: {text}" for text in texts)]


def _read(path: str) -> Identification:
    """Read a stored identification; the reader verifies its claims."""
    given = read_text(path)
    try:
        found = parsed(given)
    except ValueError as error:
        raise SetidError(f"{path}: {error}") from None
    if isinstance(found, dict) and "is" not in found and {"file", "model"} <= set(found):
        raise SetidError(
            f"{path}: found what --json writes, numbers for other programs without their proofs, "
            "expected what `setid identify --certificate` writes"
        )
    if not isinstance(found, dict) or found.get("is") != "identification":
        return from_json(json.dumps(found))
    if not isinstance(found.get("result"), dict):
        raise SetidError(
            f"{path}: found no part 'result', expected what `setid identify --certificate` writes; "
            "checker/check.py reads files without it"
        )
    stored = {"format": "setid", "version": 1, "is": "result", "result": found.pop("result")}
    result = from_json(json.dumps(stored))
    again = json.loads(json.dumps(certificate_files(result)))
    if found.get("version") != again["version"]:
        raise SetidError(
            f"{path}: found version {found.get('version')!r:.20}, expected {again['version']}; "
            "checker/check.py reads older versions as well"
        )
    if again != found:
        raise SetidError(f"{path}: found two parts that claim different things, expected one claim")
    return result


def _record(arguments: argparse.Namespace, stored: IOData) -> IOData:
    """Read a table with the channels, sampling time and given ranges of a stored record."""
    path, decimal, header = arguments.record, arguments.decimal, arguments.header
    columns: list[str | int] = [*stored.input_names, *stored.output_names]
    known = column_names(path, decimal, header)
    named = isinstance(known[0], str)
    apart = named and all(known) and len({*known}) == len(known)
    if not apart and any(known.count(name) != 1 for name in columns):
        columns = _places(arguments, stored, range(len(known)) if named else known)
    nu = stored.inputs
    found = IOData.from_csv(
        path, columns[:nu], columns[nu:], stored.Ts, decimal=decimal, header=header
    )
    if arguments.rows is not None:
        found = found.part(*part_of(arguments.rows, found.samples))
    return IOData(
        found.u,
        found.y,
        found.Ts,
        starts=found.starts,
        assumptions=found.assumptions,
        u_range=stored.u_range,
        y_range=stored.y_range,
    )


def _places(
    arguments: argparse.Namespace, stored: IOData, numbers: Iterable[Any]
) -> list[str | int]:
    """Find columns that no name tells by their readings, those with the fewest other ones."""
    path, decimal, header = arguments.record, arguments.decimal, arguments.header
    columns: dict[str | int, NDArray[np.float64]] = {}
    for place in numbers:
        try:
            values = read_table(path, [place], decimal, header).columns[0]
        except DataError:  # a column of dates or words holds no channel
            continue
        part = (0, values.size) if arguments.rows is None else part_of(arguments.rows, values.size)
        columns[place] = values[slice(*part)]
    channels = [*stored.u.T, *stored.y.T]
    if len(columns) < len(channels):
        raise DataError(
            f"{path}: found {len(columns)} columns of numbers, expected {len(channels)}"
        )
    found: list[str | int] = []
    for one in channels:
        others = {k: _others(held, one) for k, held in columns.items() if k not in found}
        found.append(min(others, key=others.__getitem__))
    return found


def _others(held: NDArray[np.float64], one: NDArray[np.float64]) -> int:
    """Count the readings of a column that are not those of a channel."""
    shared = min(held.size, one.size)
    a, b = held[:shared], one[:shared]
    return int(np.sum((a != b) & ~(np.isnan(a) & np.isnan(b))))
