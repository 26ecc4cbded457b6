"""The command line of the checker."""

from __future__ import annotations

import sys
from typing import Any

from .files import reading, text
from .files.reading import Malformed, Problem
from .files.tables import part_of, table_of
from .rational import RationalProblem, check_rational_certificate, check_rational_result
from .records.record import Identification
from .records.structure import columns_of
from .result import NotProved, check_certificate, check_result, remarks

USAGE = """usage: check.py problem.json certificate.json     (the problem also as .gms or text)
       check.py result.json
       check.py [--record record.csv [--decimal ,] [--header LINES] [--rows FIRST:END]]
                identification.json

--record   the table of samples, as separated by semicolons, tabs, commas or blanks
--decimal  its decimal mark, . when left out
--header   its lines before the first sample, comments left out, of which the first holds names
--rows     the samples that were identified, from 0 to the one before END

exit codes: 0 proved; 1 not proved; 2 malformed; 3 proved but for what is taken as given"""

UNEXPECTED = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError


def main(arguments: list[str]) -> int:
    """Check the files; print what is proved, or where and why it fails."""
    if arguments in (["--help"], ["-h"]):
        return told(USAGE, 0)
    try:
        lines = checked(arguments)
    except NotProved as error:
        return told(f"NOT PROVED  {error}", 1)
    except Malformed as error:
        return told(f"MALFORMED  {error}", 2)
    except UNEXPECTED as e:
        return told(f"MALFORMED  something that nobody expected: {e!r:.200}", 2)
    given = any(line.startswith("taken as given") for line in lines)
    return told("\n".join(lines), 3 if given else 0)


def told(words: str, code: int) -> int:
    """Print where the output is not closed, and return the exit code."""
    if sys.stdout is not None:
        sys.stdout.write(words + "\n")
    return code


def checked(arguments: list[str]) -> list[str]:
    """Tell what the files prove."""
    options, arguments = split_options(arguments)
    if "--record" in options and len(arguments) == 1:
        name, found = reading.content(reading.load(arguments[0]), arguments[0])
        if name == "identification":
            about = Identification(found)
            path, count = options["--record"], options.get("--header")
            header = None if count is None else int(count)
            table = table_of(path, options.get("--decimal", "."), header)
            names, columns = table[0], part_of(table[1], options.get("--rows", ":"))
            return [*columns_of(about.record, path, names, columns), *about.check()]
    if options or not 1 <= len(arguments) <= 2:
        raise Malformed(USAGE)
    name, found = reading.content(reading.load(arguments[-1]), arguments[-1])
    if name.startswith("rational_"):
        return about_ratios(name, found, arguments)
    problem, stated = problem_of(arguments[0]) if len(arguments) == 2 else (None, None)
    if name == "identification" and problem is None:
        return Identification(found).check()
    given = found
    if name == "result":
        lines, given = check_result(found, problem), reading.item(found, "certificate", "result")
        stated = reading.item(found, "problem", "result") if problem is None else stated
        problem = problem or reading.problem(stated)
    elif name == "certificate" and problem is not None:
        lines = check_certificate(problem, found)
    else:
        raise Malformed(f"{arguments[-1]} holds a {name!r:.40}\n{USAGE}")
    lines += remarks(stated, given) if stated and given else []
    negated = ["(objective is the negative of what is maximised)"]
    return lines + (negated if problem.sense == "max" else [])


def split_options(arguments: list[str]) -> tuple[dict[str, str], list[str]]:
    """Split options of a record with their values from files."""
    options, files, words = dict[str, str](), list[str](), list(arguments)
    while words:
        word = words.pop(0)
        if word in ("--record", "--decimal", "--header", "--rows") and words:
            options[word] = words.pop(0)
        else:
            files.append(word)
    known = options.get("--decimal", ".") in (".", ",") and options.get("--header", "0").isdecimal()
    if not known or any(word.startswith("--") for word in files):
        raise Malformed(USAGE)
    return options, files


def about_ratios(name: str, found: Any, arguments: list[str]) -> list[str]:
    """Tell what files about ratios prove; their problem has to be JSON."""
    about = None
    if len(arguments) == 2:
        kind, stated = reading.content(reading.load(arguments[0]), arguments[0])
        if kind == "rational_result":
            stated = reading.item(stated, "problem", kind)
        elif kind != "rational_problem":
            raise Malformed(f"{arguments[0]} holds a {kind!r:.40}, not a problem with ratios")
        about = RationalProblem(stated)
    if name == "rational_result":
        lines = check_rational_result(found, about)
    elif name == "rational_certificate" and about is not None:
        lines = check_rational_certificate(about, found)
    else:
        raise Malformed(f"{arguments[-1]} holds a {name!r:.40}\n{USAGE}")
    sense = found["problem"].get("sense") if about is None else about.base.sense
    return lines + (["(objective is the negative of what is maximised)"] * (sense == "max"))


def problem_of(path: str) -> tuple[Problem, Any]:
    """Read the problem that a file holds, and its JSON or None."""
    if not path.endswith(".json"):
        return text.problem_of(path), None
    name, found = reading.content(reading.load(path), path)
    if name == "result":
        found = reading.item(found, "problem", path)
    elif name != "problem":
        raise Malformed(f"{path} holds a {name!r:.40}, not a problem")
    return reading.problem(found), found
