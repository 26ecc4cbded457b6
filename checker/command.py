"""The command line of the checker."""

from __future__ import annotations

import sys
from typing import Any

from . import reading, text
from .reading import Malformed, Problem
from .result import NotProved, check_certificate, check_result

USAGE = "usage: check.py [problem] certificate-or-result.json"


def main(arguments: list[str]) -> int:
    """Check the files; print what is proved, or where and why it fails."""
    try:
        lines = checked(arguments)
    except NotProved as error:
        print(f"NOT PROVED  {error}")
        return 1
    except Malformed as error:
        print(f"MALFORMED  {error}")
        return 2
    except (RecursionError, MemoryError):
        print("MALFORMED  the input is too deep or too large")
        return 2
    for line in lines:
        print(line)
    return 0


def checked(arguments: list[str]) -> list[str]:
    """What the files prove."""
    if not 1 <= len(arguments) <= 2:
        raise Malformed(USAGE)
    problem = problem_of(arguments[0]) if len(arguments) == 2 else None
    name, found = reading.content(reading.load(arguments[-1]), arguments[-1])
    if name == "result":
        lines = check_result(found, problem)
        sense = reading.problem(reading.item(found, "problem", "result")).sense
    elif name == "certificate" and problem is not None:
        lines, sense = check_certificate(problem, found), problem.sense
    else:
        raise Malformed(f"{arguments[-1]} holds a {name}; {USAGE}")
    remark = "(objective is the negative of what is maximised)"
    return [*lines, remark] if sense == "max" else lines


def problem_of(path: str) -> Problem:
    """The problem in a file, by what the file holds."""
    if path.endswith(".json"):
        name, found = reading.content(reading.load(path), path)
        if name == "result":
            found = reading.item(found, "problem", path)
        elif name != "problem":
            raise Malformed(f"{path} holds a {name}, not a problem")
        return reading.problem(found)
    return text.problem_of(path)


def run(files: list[Any]) -> None:
    """Run :func:`main` and leave the process."""
    sys.exit(main([str(file) for file in files]))
