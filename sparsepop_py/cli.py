# PYTHON_ARGCOMPLETE_OK
"""Command line: ``sparsepop solve FILE``, ``orders``, ``info``, ``study`` and ``verify``."""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Sequence
from contextvars import ContextVar
from glob import glob
from itertools import chain
from pathlib import Path
from typing import Any

from sparsepop_py import __version__, plots
from sparsepop_py.commands.parsers import add_command
from sparsepop_py.commands.study import add_study
from sparsepop_py.commands.verify import add_verify
from sparsepop_py.errors import (
    FormatError,
    OutputError,
    ProblemError,
    SolverNotFound,
    check_writable,
)
from sparsepop_py.files import read_bytes, write_text
from sparsepop_py.formats import FORMATS, read, read_stream
from sparsepop_py.io.json_files.files import write_json
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.relaxation.moment import relax
from sparsepop_py.result import Result, Status
from sparsepop_py.solvers import solver_names
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.study.orders import compare_orders
from sparsepop_py.study.problems import Study
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = [
    "EXIT_INPUT",
    "EXIT_INTERRUPT",
    "EXIT_MISSING",
    "EXIT_OPEN",
    "EXIT_OUTPUT",
    "EXIT_PIPE",
    "EXIT_PROVED",
    "add_json",
    "check_outputs",
    "check_picture",
    "json_number",
    "main",
    "print_or_write",
    "run_commands",
]

EXIT_PROVED = 0
EXIT_OPEN = 1
EXIT_INPUT = 2
EXIT_MISSING = 3
EXIT_OUTPUT = 5
EXIT_INTERRUPT = 130  # as shells count a process that ended by SIGINT
EXIT_PIPE = 141  # as shells count a process that ended by SIGPIPE
_READER_GONE = ContextVar("reader_gone", default=False)  # of the standard output
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}  # of a standard output

_CODES = """exit codes:
  0  the answer is proved: the gap is closed, or the problem is infeasible or unbounded
  1  the gap is open, or nothing is proved
  2  the input is wrong (the message is on standard error)
  3  software is missing (the message says what to install)
  5  an output cannot be written (what was found is printed before)
  130  Ctrl-C came where nothing is kept: before the work, at its end, or twice
"""
AnyResult = Result | RationalResult
_PROVED = (Status.OPTIMAL, Status.INFEASIBLE, Status.UNBOUNDED)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the name of the program; those of the process when left out.

    Returns
    -------
    int
        The exit code; see ``sparsepop --help``.

    Examples
    --------
    >>> main(["solve", "nowhere.gms"])
    2
    """
    return run_commands("sparsepop", _parser(), argv, (ProblemError, FormatError))


def run_commands(
    program: str,
    parser: argparse.ArgumentParser,
    argv: Sequence[str] | None,
    wrong_input: tuple[type[Exception], ...],
) -> int:
    """Parse arguments and run the command that they name, with messages for people.

    Parameters
    ----------
    program : str
        Name in front of messages on standard error.
    parser : argparse.ArgumentParser
        Each command sets ``run``, a function of the parsed arguments that returns an exit code.
    argv : sequence of str or None
        Those of the process for None.
    wrong_input : tuple of exception types
        What ends with code 2 and its message; missing software ends with code 3, an interrupt
        that the command does not take with code 130.

    Returns
    -------
    int
    """
    _complete(parser)
    if sys.stdout is None:  # closed by whoever started the command
        print(f"{program}: standard output: found it closed, expected it open", file=sys.stderr)
        return EXIT_OUTPUT
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:  # argparse: 0 after --help and --version, 2 for wrong usage
        return int(stop.code or 0)
    wrong: tuple[type[Exception], ...] = (*wrong_input, OSError)
    _READER_GONE.set(False)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
        return EXIT_PIPE if _READER_GONE.get() else code
    except BrokenPipeError:  # whoever read has read enough
        _discard_output()
        return EXIT_PIPE
    except OutputError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_OUTPUT
    except wrong as error:
        if isinstance(error, OSError) and error.filename is None and error.errno in _FULL:
            print(f"{program}: standard output: cannot be written: {error}", file=sys.stderr)
            _discard_output()
            return EXIT_OUTPUT
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_INPUT
    except SolverNotFound as error:
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_MISSING
    except KeyboardInterrupt:  # where work is under way, it ends that and what is proved is kept
        print(f"{program}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPT


def _discard_output() -> None:
    """Discard the rest of the output, so that the last flush succeeds."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def _complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks for completions, where argcomplete is installed."""
    if "_ARGCOMPLETE" in os.environ:
        with contextlib.suppress(ImportError):
            import argcomplete

            argcomplete.autocomplete(parser)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sparsepop",
        description="Proved bounds for sparse polynomial optimization problems.",
        epilog=_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"sparsepop-py {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, run, text in (
        ("solve", _solve, "prove a bound, find a point, and print both"),
        ("orders", _orders, "compare relaxation orders, plain and with presolve"),
        ("info", _info, "print sizes and blocks without solving"),
    ):
        command = add_command(commands, name, text, run, _CODES)
        command.add_argument(
            "file",
            nargs="?",  # --json FILE takes it
            metavar="FILE",
            help=f"a problem: {', '.join(FORMATS)}; - for standard input",
        )
        command.add_argument(
            "--format", metavar=".END", choices=list(FORMATS), help="read FILE as if it ended so"
        )
        if run is not _orders:
            command.add_argument("--order", type=int, help="relaxation order; the least by default")
        command.add_argument("--dense", action="store_true", help="one clique of all variables")
        if run is _solve:
            _add_solve_options(command)
        elif run is _orders:
            _add_orders_options(command)
    add_verify(commands)
    _add_problem_files(add_study(commands, Study))
    return parser


def _add_orders_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--orders", nargs="+", type=int, default=[1, 2, 3], metavar="ORDER", help="default: 1 2 3"
    )
    command.add_argument(
        "--effort",
        nargs="+",
        choices=["plain", "presolve"],
        default=["plain", "presolve"],
        help="default: both",
    )
    command.add_argument(
        "--both", action="store_true", help="cliques of the problem, and one of all variables"
    )
    _add_outputs(command)


def _add_problem_files(command: argparse.ArgumentParser) -> None:
    """Let a study take files x orders as its tasks before it runs."""
    command.add_argument("files", metavar="FILE", nargs="*", help="problems to add before it runs")
    command.add_argument(
        "--orders",
        type=int,
        nargs="+",
        metavar="D",
        help="of each file, the least legal one if smaller",
    )
    command.add_argument("--auto", action="store_true", help="effort auto, without clocks")
    command.add_argument("--time-limit", type=float, metavar="S", help="seconds for each problem")
    command.set_defaults(prepare=_tasks)


def _refuse_options(arguments: argparse.Namespace) -> None:
    """Refuse options of files where there are none."""
    for name in ("orders", "auto", "time_limit"):
        value = getattr(arguments, name)
        if value is not None and value is not False:  # 0 is one
            option = f"--{name.replace('_', '-')}"
            raise ProblemError(f"{option}: found no FILE, expected the files that it is about")


def _matching(given: str) -> list[str]:
    """List files of a pattern, which the name of a file is not."""
    return [given] if os.path.lexists(given) else sorted(glob(given)) or [given]


def _tasks(arguments: argparse.Namespace) -> list[tuple[str, Problem, Options, dict[str, Any]]]:
    """Read the files and list their tasks, as ``Study.add_all`` takes them."""
    if not arguments.files:
        _refuse_options(arguments)
    tasks: list[tuple[str, Problem, Options, dict[str, Any]]] = []
    for path in chain.from_iterable(map(_matching, arguments.files)):
        problem = read(path)
        if not isinstance(problem, Problem):
            raise ProblemError(f"{path}: found ratios, expected polynomials in a study")
        for order in arguments.orders or [None]:
            options = Options(
                order=order,
                effort="auto" if arguments.auto else "presolve",
                time_limit=arguments.time_limit,
            )
            tags: dict[str, str | int] = {"file": path}
            if order is not None:
                tags["order"] = order
            name = path if order is None else f"{path} order {order}"
            tasks.append((name, problem, options, tags))
    return tasks


def _add_solve_options(command: argparse.ArgumentParser) -> None:
    effort = command.add_mutually_exclusive_group()
    effort.add_argument(
        "--plain", action="store_true", help="the bounds as given, no search for tighter ones"
    )
    effort.add_argument(
        "--auto",
        action="store_true",
        help="more relaxations and branch and bound while the gap is open",
    )
    command.add_argument(
        "--certificate",
        metavar="OUT.json",
        help="write the result with its proof, for `sparsepop verify` and checker/check.py",
    )
    _add_outputs(command)


def _solver(name: str) -> str:
    """Refuse the name of no solver; what is behind a colon is another package's."""
    if ":" in name or name in solver_names():
        return name
    raise argparse.ArgumentTypeError(f"found {name!r}, expected {', '.join(solver_names())}")


def _add_outputs(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--solver",
        default="auto",
        type=_solver,
        metavar="NAME",
        help=", ".join(solver_names()),
    )
    command.add_argument(
        "--time-limit", type=float, metavar="S", help="seconds of wall time for each solve"
    )
    command.add_argument("--gap", type=float, default=1e-6, help="what counts as closed (1e-6)")
    command.add_argument("--cpu-limit", type=float, metavar="S", help="seconds of CPU time")
    add_json(command)
    command.add_argument("--plot", metavar="OUT.png", help="write a picture of the result")


_OUTPUTS = ("json", "certificate", "plot", "report")


def add_json(command: argparse.ArgumentParser) -> None:
    """Add the option ``--json``.

    Parameters
    ----------
    command : argparse.ArgumentParser
    """
    command.add_argument(
        "--json",
        nargs="?",
        const="-",
        metavar="OUT.json",
        help="write the result as JSON beside the text; without a file name, or with -, print it "
        "in place of the text",
    )


def check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse files that cannot be written, before the work and not after it.

    Parameters
    ----------
    arguments : argparse.Namespace
        With ``json`` and possibly ``plot``, ``report``, ``certificate`` and the input ``file`` or
        ``record``.

    Raises
    ------
    ProblemError
        If a folder does not exist, or a file is named twice: an output would replace the input or
        another output.
    """
    given = {f"--{name}": getattr(arguments, name, None) for name in _OUTPUTS}
    outputs = {option: path for option, path in given.items() if path is not None}
    if outputs.get("--json") == "-":
        del outputs["--json"]
    if "--plot" in outputs:
        check_picture(outputs["--plot"])
    inputs = (getattr(arguments, name, None) for name in ("file", "record"))
    taken = {os.path.realpath(path): "the input" for path in inputs if path not in (None, "-")}
    for option, path in outputs.items():
        if path == "-":
            raise ProblemError(f"{option}: found '-', expected a file; only --json is printed")
        check_writable(path, option)
        other = taken.setdefault(os.path.realpath(path), option)
        if other != option:
            raise ProblemError(f"{option}: found {path!r} as {other} too, expected another file")


def print_or_write(path: str | None, record: Any, text: str) -> None:
    """Print the text and write the record; for ``-`` print the record alone.

    Parameters
    ----------
    path : str or None
        What ``--json`` holds; None prints the text alone.
    record : object
        As plain data, without NaN and infinities.
    text : str
    """
    encoded = json.dumps(record, indent=2, allow_nan=False) if path is not None else ""
    try:  # nothing is lost if files cannot be written
        print(encoded if path == "-" else text, flush=True)
    except BrokenPipeError:  # whoever read has read enough: files are written all the same
        _discard_output()
        _READER_GONE.set(True)
    if path not in (None, "-"):
        write_text(str(path), encoded + "\n")


# ---- solve ------------------------------------------------------------------------------


def check_picture(path: str) -> None:
    """Refuse a path that no picture can be written to, before the work.

    Parameters
    ----------
    path : str
        Of the option ``--plot``.

    Raises
    ------
    ProblemError
        If the folder does not exist or the ending is unknown.
    """
    known = plots.require_matplotlib().FigureCanvasBase.get_supported_filetypes()
    check_writable(path, "--plot")
    if Path(path).suffix.removeprefix(".").lower() not in known:
        endings = ", ".join(f".{name}" for name in known)
        raise ProblemError(f"--plot: found {path!r}, expected a file that ends in one of {endings}")


def _problem(arguments: argparse.Namespace) -> Problem | RationalProblem:
    """Read the file that was named, or standard input."""
    if arguments.file is None and getattr(arguments, "json", None) not in (None, "-"):
        arguments.file, arguments.json = arguments.json, "-"  # solve --json FILE
    if arguments.file is None:
        raise ProblemError("the following arguments are required: FILE")
    if arguments.file == "-":
        if sys.stdin is None:
            raise ProblemError("standard input: found it closed, expected a problem")
        return read_stream(sys.stdin.buffer.read(), arguments.format)
    if arguments.format is not None:
        return read_stream(read_bytes(arguments.file), arguments.format, arguments.file)
    return read(arguments.file)


def _solve(arguments: argparse.Namespace) -> int:
    problem = _problem(arguments)
    check_outputs(arguments)
    if arguments.plot and isinstance(problem, RationalProblem):
        raise ProblemError("--plot: found a problem with ratios, expected a polynomial one")
    options = Options(
        order=arguments.order,
        effort="plain" if arguments.plain else "auto" if arguments.auto else "presolve",
        sparse=not arguments.dense,
        solver=arguments.solver,
        time_limit=arguments.time_limit,
        cpu_limit=arguments.cpu_limit,
        gap=arguments.gap,
        progress=True,
    )
    result = solve(problem, options)
    record = _record(arguments.file, result) if arguments.json else None
    print_or_write(arguments.json, record, _text(arguments.file, result))
    if arguments.certificate:
        write_json(result, arguments.certificate)
    if arguments.plot and isinstance(result, Result):
        plots.save_plot(result, arguments.plot)
    return EXIT_PROVED if result.status in _PROVED else EXIT_OPEN


def _interval(result: AnyResult) -> tuple[float, float]:
    """Return the interval of the optimal value, in the sense of the file."""
    low, high = result.lower_bound, result.upper_bound
    return (-high, -low) if result.problem.sense == "max" else (low, high)


def _text(path: str, result: AnyResult) -> str:
    maximise = result.problem.sense == "max"
    low, high = _interval(result)
    words = ("attained", "proved") if maximise else ("proved", "attained")
    sizes = repr(result.problem).partition(" ")[2][:-1]
    lines = [
        f"{path}: {sizes}, {'maximise' if maximise else 'minimise'}",
        f"status        {result.status}: {result.message}",
    ]
    if result.status not in (Status.INFEASIBLE, Status.UNBOUNDED):
        lines += [
            f"lower bound   {rounded(low, False, scientific=True)}  {_how(low, words[0])}",
            f"upper bound   {rounded(high, True, scientific=True)}  {_how(high, words[1])}",
            f"gap           {rounded(result.gap, True, 3)}",
        ]
    lines += _point(result)
    if result.relaxation is not None:
        lines.append(str(result.relaxation))
    stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in result.timings.items())
    lines.append(f"CPU seconds   {stages}")
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def _how(value: float, word: str) -> str:
    return word if math.isfinite(value) else f"nothing {word}"


def _point(result: AnyResult) -> list[str]:
    if result.x is None:
        return []
    pairs = zip(result.problem.names, result.x.tolist(), strict=True)
    shown = [f"{name} = {value:.9g}" for name, value in pairs]
    more = f", ... ({len(shown)} variables)" if len(shown) > 12 else ""
    lines = [f"point         {', '.join(shown[:12])}{more}"]
    if result.attained is None:
        lines.append(f"              violates by {result.problem.violation(result.x):.2g}")
    return lines


def json_number(value: float) -> float | str | None:
    """Convert a number to JSON, infinities to the strings that ``float`` reads.

    Parameters
    ----------
    value : float
    """
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else str(value)


def _verify(result: AnyResult) -> bool:
    if isinstance(result, RationalResult):
        return result.certificate.verify(result.problem).ok
    return result.certificate is not None and result.certificate.verify(result.problem).ok


def _record(path: str, result: AnyResult) -> dict[str, Any]:
    problem, relaxation = result.problem, result.relaxation
    low, high = _interval(result)
    verified = _verify(result)
    sizes: dict[str, Any] = {
        "variables": problem.dimension,
        "constraints": len(problem.constraints),
        "degree": problem.degree,
    }
    if relaxation is not None:
        sizes |= {
            "order": relaxation.order,
            "cliques": len(relaxation.cliques),
            "moments": relaxation.moments.shape[0],
            "rows": relaxation.rows,
            "blocks": {str(size): count for size, count in sorted(relaxation.block_sizes.items())},
        }
    return {
        "file": path,
        "sense": problem.sense,
        "status": str(result.status),
        "message": result.message,
        "lower_bound": json_number(low),
        "upper_bound": json_number(high),
        "gap": json_number(result.gap),
        "attained": result.attained is not None,
        "certificate_verified": verified,
        "names": list(problem.names),
        "x": None if result.x is None else result.x.tolist(),
        "violation": None if result.x is None else json_number(problem.violation(result.x)),
        "sizes": sizes,
        "timings": result.timings,
        "notes": list(result.notes),
    }


# ---- orders -----------------------------------------------------------------------------


def _orders(arguments: argparse.Namespace) -> int:
    problem = _problem(arguments)
    check_outputs(arguments)
    if isinstance(problem, RationalProblem):
        raise ProblemError(f"{arguments.file}: found ratios, expected polynomials in orders")
    cliques = ("sparse", "dense") if arguments.both else ("dense",) if arguments.dense else ()
    compared = compare_orders(
        problem,
        arguments.orders,
        arguments.effort,
        cliques or ("sparse",),
        Options(
            solver=arguments.solver,
            time_limit=arguments.time_limit,
            cpu_limit=arguments.cpu_limit,
            gap=arguments.gap,
            progress=True,
        ),
    )
    rows = [
        {key: json_number(v) if isinstance(v, float) else v for key, v in row.items()}
        for row in compared.records()
    ]
    record = {"file": arguments.file, "sense": problem.sense, "rows": rows}
    print_or_write(arguments.json, record, f"{arguments.file}\n{compared.table()}")
    if arguments.plot:
        compared.plot(arguments.plot)
    closed = any(row.result.status in _PROVED for row in compared.rows)
    return EXIT_PROVED if closed else EXIT_OPEN


# ---- info -------------------------------------------------------------------------------


def _info(arguments: argparse.Namespace) -> int:
    problem = _problem(arguments)
    if isinstance(problem, RationalProblem):
        print(f"{arguments.file}: {repr(problem)[1:-1]}")
        for denominator in problem.denominators:
            print(f"denominator   {denominator}")
        return EXIT_PROVED
    options = Options(order=arguments.order, sparse=not arguments.dense)
    cliques = find_cliques(problem, sparse=options.sparse)
    print(f"{arguments.file}: {repr(problem)[10:-1]}")
    print(f"sense         {problem.sense}")
    print(f"bounds        {_bounds(problem)}")
    print(relax(problem, options.order, cliques=cliques))
    return EXIT_PROVED


def _bounds(problem: Problem) -> str:
    counts: Counter[str] = Counter()
    for low, high in zip(problem.lower, problem.upper, strict=True):
        finite = math.isfinite(low) + math.isfinite(high)
        counts["fixed" if low == high else ("none", "one", "both")[finite]] += 1
    return ", ".join(f"{kind}: {counts[kind]}" for kind in sorted(counts)) + " (variables)"


if __name__ == "__main__":
    sys.exit(main())
