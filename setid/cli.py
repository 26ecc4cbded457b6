# PYTHON_ARGCOMPLETE_OK
"""The command line: ``setid identify RECORD.csv ...`` and ``setid consistency RECORD.csv ...``."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from collections.abc import Sequence
from math import inf
from typing import Any, Literal, get_args

import sparsepop_py as sp
from setid.consistency import consistency
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.data.tables import column_names
from setid.errors import DataError, ModelError, NoiseError, SetidError
from setid.identify import identify
from setid.minimum_noise.consistency_result import Consistency
from setid.models.continuous import ContinuousTransferFunction, Hold, Method
from setid.models.equations import Initial, Structure
from setid.models.lti import TransferFunction
from setid.models.registry import families, family_of
from setid.options import Options
from setid.plots.intervals import plot_intervals
from setid.priors import DCGain, Stable
from setid.priors.registry import read_prior
from setid.proofs.evidence import Verification
from setid.proofs.intervals import IntervalStatus
from setid.result.identification import Identification
from setid.result.json_ import certificate_text
from setid.result.page import require_software
from setid.study import Study
from setid.verify_command import add_verify, part_of
from sparsepop_py.cli import (
    EXIT_INPUT,
    EXIT_MISSING,
    EXIT_OPEN,
    EXIT_PROVED,
    add_json,
    check_outputs,
    json_number,
    print_or_write,
    run_commands,
)
from sparsepop_py.commands.parsers import add_command
from sparsepop_py.commands.study import add_study
from sparsepop_py.files import write_text

__all__ = [
    "EXIT_EMPTY",
    "EXIT_INPUT",
    "EXIT_MISSING",
    "EXIT_OPEN",
    "EXIT_PROVED",
    "add_structure",
    "main",
    "structure_from",
]

EXIT_EMPTY = 4

_NOISE = {
    "output": "largest error of a measured output",
    "input": "largest error of a measured input",
    "equation": "largest error of the difference equation",
}
_RELATIVE = "bounds of outputs and inputs are shares of readings"
_TOL = "what counts as closed, as a fraction of the attained width (1e-3)"
_VERIFIED = "verified: box, outer and inner ends follow from the record, without any solver"
_CODES = """exit codes:
  0  every interval is certified; for consistency: the data are explained by these bounds
  1  an interval is proved but not closed, or unbounded, or not identifiable
  2  the input is wrong (the message is on standard error)
  3  software is missing (the message says what to install)
  4  it is proved that no parameter is consistent with the data: order or bounds are wrong
  5  an output cannot be written (what was found is printed before)
  130  Ctrl-C came where nothing is kept: before the work, at its end, or twice

columns: by name from the first line, or by number from 0. Without --input and --output
the columns u and y are taken, or 0 and 1 in a file without names.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the name of the program; those of the process when left out.

    Returns
    -------
    int
        The exit code; see ``setid --help``.

    Examples
    --------
    >>> main(["identify", "nowhere.csv", "--na", "1", "--nb", "1", "--output-noise", "1"])
    2
    """
    return run_commands("setid", _parser(), argv, (SetidError, sp.ProblemError, sp.FormatError))


# ---- arguments --------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="setid",
        description="Guaranteed parameter intervals from records with bounded noise.",
        epilog=_CODES,
        formatter_class=layout,
    )
    parser.add_argument("--version", action="version", version=f"sparsepop-py {sp.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, run, text in (
        ("identify", _identify, "prove an interval for each parameter"),
        ("consistency", _consistency, "find the least noise that explains the record"),
    ):
        command = add_command(commands, name, text, run, _CODES)
        command.add_argument("record", metavar="RECORD.csv", help="a table of samples")
        _add_data(command)
        add_structure(command)
        command.add_argument("--time-limit", type=float, metavar="S", help="seconds of wall time")
        command.add_argument("--cpu-limit", type=float, metavar="S", help="seconds of CPU time")
        command.add_argument("--tol", type=float, default=1e-3, help=_TOL)
        add_json(command)
        if run is _identify:
            command.add_argument("--plot", metavar="OUT.png", help="write a picture")
            command.add_argument(
                "--report",
                metavar="OUT.html",
                help="write one page: data, assumptions, intervals, bands, residuals",
            )
            command.add_argument(
                "--certificate",
                metavar="OUT.json",
                help="write record, rows and proofs, for setid verify and checker/check.py",
            )
            command.add_argument(
                "--verify", action="store_true", help="check every claim again, without any solver"
            )
    add_verify(commands)
    add_study(commands, Study)
    _add_serve(commands)
    return parser


def _add_serve(commands: Any) -> None:
    text = "open a page for identification in the browser, on this machine alone"
    command = add_command(commands, "serve", text, _serve)
    command.add_argument("--port", type=int, default=8321, help="0 takes any that is free (8321)")
    command.add_argument("--no-browser", action="store_true", help="print the address alone")


def _serve(arguments: argparse.Namespace) -> int:
    from setid.serve.server import serve  # loads what no other command needs

    def announce(address: str) -> None:
        print(f"setid serves {address} (Ctrl-C ends it)", flush=True)
        if not arguments.no_browser:
            webbrowser.open(address)

    if not 0 <= arguments.port < 2**16:
        raise SetidError(f"--port: found {arguments.port}, expected a number from 0 to 65535")
    serve(arguments.port, announce)
    return EXIT_PROVED


def _add_data(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("record")
    group.add_argument("--input", action="append", metavar="COLUMN", help="may be repeated")
    group.add_argument("--output", action="append", metavar="COLUMN", help="may be repeated")
    group.add_argument("--Ts", type=float, help="sampling time (of --time, else 1)")
    group.add_argument("--time", metavar="COLUMN", help="of times, which are checked")
    group.add_argument("--decimal", choices=(".", ","), default=".", help="decimal mark (.)")
    group.add_argument("--header", type=int, metavar="LINES", help="2: names, then units")
    group.add_argument("--rows", metavar="FIRST:END", help="part of the record, from 0")
    for kind in ("output", "input", "equation"):
        group.add_argument(f"--{kind}-noise", type=float, metavar="BOUND", help=_NOISE[kind])
    group.add_argument("--relative", action="store_true", help=_RELATIVE)


def _record(arguments: argparse.Namespace) -> IOData:
    names = column_names(arguments.record, arguments.decimal, arguments.header)
    inputs = _columns(arguments.input, names) or [_default_columns(arguments, names)[0]]
    outputs = _columns(arguments.output, names) or [_default_columns(arguments, names)[1]]
    times = None if arguments.time is None else _columns([arguments.time], names)[0]
    data = IOData.from_csv(
        arguments.record,
        inputs,
        outputs,
        arguments.Ts,
        decimal=arguments.decimal,
        header=arguments.header,
        time=times,
    )
    if arguments.rows is None:
        return data
    return data.part(*part_of(arguments.rows, data.samples))


def _columns(given: list[str] | None, names: list[str | int]) -> list[str | int]:
    """Take texts as names of columns where each names one, else as numbers if they are some."""
    return [
        int(text) if text.isdecimal() and names.count(text) != 1 else text for text in given or []
    ]


def _default_columns(
    arguments: argparse.Namespace, names: list[str | int]
) -> tuple[str | int, str | int]:
    """Take u and y where the first line holds names, else the columns if there are two."""
    if isinstance(names[0], str):
        return "u", "y"
    if len(names) != 2:
        raise DataError(
            f"{arguments.record}: found {len(names)} columns without names, expected two, an input "
            "and an output; say which by --input and --output, numbers from 0"
        )
    return names[0], names[1]


def _parts(
    arguments: argparse.Namespace,
) -> tuple[IOData, Structure, Noise, list[Any]]:
    data = _record(arguments)
    model = structure_from(arguments, data)
    noise = _noise(arguments)
    priors: list[Any] = [Stable()] if arguments.stable else []
    priors += [read_prior(text) for text in arguments.prior or []]
    if arguments.dc_gain:
        priors.append(DCGain(*arguments.dc_gain))
    return data, model, noise, priors


def _noise(arguments: argparse.Namespace) -> Noise:
    """The bounds that were given; without any there is nothing to prove."""
    output, input, equation = (getattr(arguments, f"{kind}_noise") for kind in _NOISE)
    for kind, bound in zip(_NOISE, (output, input, equation), strict=True):
        if bound is not None and not 0.0 <= bound < inf:
            raise NoiseError(f"--{kind}-noise: found {bound:g}, expected a finite bound >= 0")
    if output is input is equation is None:
        raise NoiseError(
            "--output-noise, --input-noise, --equation-noise: found none, expected a bound of the "
            "errors of at least one kind (0 says exact); where no bound is known, `setid "
            "consistency` with a guess, such as --output-noise 1, finds the least one that "
            "explains the record"
        )
    if arguments.relative and output is input is None:
        raise NoiseError(
            "--relative: found it with --equation-noise alone, expected it with --output-noise or "
            "--input-noise; bounds of equation errors are no shares of readings"
        )
    return Noise(output or 0.0, input or 0.0, equation or 0.0, relative=arguments.relative)


def _options(arguments: argparse.Namespace) -> Options:
    return Options(
        tol=arguments.tol, time_limit=arguments.time_limit, cpu_limit=arguments.cpu_limit
    )


# ---- identify ---------------------------------------------------------------------------


def _identify(arguments: argparse.Namespace) -> int:
    check_outputs(arguments)
    if arguments.report:
        require_software()
    data, model, noise, priors = _parts(arguments)
    result = identify(data, model, noise, priors, _options(arguments))
    checked = result.verify(data) if arguments.verify else None
    record = _as_record(arguments.record, result, checked)
    text = f"{arguments.record}: {data!r}\n{result.summary()}"
    if checked is not None:
        text += f"\n{_VERIFIED if checked else f'NOT VERIFIED: {checked.reason}'}"
    print_or_write(arguments.json, record, text)
    if arguments.certificate:
        write_text(arguments.certificate, certificate_text(result) + "\n")
    if arguments.plot:
        _save(result, arguments.plot)
    if arguments.report:
        result.report(arguments.report)
    if checked is not None and not checked:
        return EXIT_OPEN
    if result.empty:
        return EXIT_EMPTY
    return EXIT_PROVED if result.status is IntervalStatus.CERTIFIED else EXIT_OPEN


def _save(result: Identification, path: str) -> None:
    figure = plot_intervals(result).get_figure(root=True)
    assert figure is not None
    figure.savefig(path, dpi=150)


def _as_record(path: str, result: Identification, checked: Verification | None) -> dict[str, Any]:
    return {
        "file": path,
        "model": repr(result.formulation.model),
        "status": str(result.status),
        "intervals": {
            name: {
                "outer": [json_number(end) for end in interval.outer],
                "inner": None
                if interval.inner is None
                else [json_number(e) for e in interval.inner],
                "status": str(interval.status),
            }
            for name, interval in result.intervals.items()
        },
        "verified": None if checked is None else checked.ok,
        "samples": [list(map(int, pair)) for pair in result.samples],
        "notes": list(result.notes),
        "assumptions": list(result.assumptions),
    }


# ---- consistency ------------------------------------------------------------------------


def _consistency(arguments: argparse.Namespace) -> int:
    check_outputs(arguments)
    data, model, noise, priors = _parts(arguments)
    found = consistency(data, model, noise, priors, _options(arguments))
    text = f"{arguments.record}: {data!r}\n{found.summary()}"
    print_or_write(arguments.json, _as_scale(arguments.record, found), text)
    return {True: EXIT_PROVED, None: EXIT_OPEN, False: EXIT_EMPTY}[found.explains]


def _as_scale(path: str, found: Consistency) -> dict[str, Any]:
    names = found.formulation.parameters
    theta = None if found.theta is None else dict(zip(names, found.theta.tolist(), strict=True))
    return {
        "file": path,
        "model": repr(found.formulation.model),
        "scale": [json_number(end) for end in found.scale],
        "explains": found.explains,
        "theta": theta,
        "samples": [list(map(int, pair)) for pair in found.samples],
        "assumptions": list(found.assumptions),
    }


_DISCRETE = ("na", "nb", "nk")
_CONTINUOUS = ("method", "delta", "tau", "hold")
_NAMED = ("order", "degree")
_SWITCHES = ("offset", "common_denominator", "from_rest")  # of structures that are not named


def add_structure(command: argparse.ArgumentParser) -> None:
    """Add the options that describe structures and priors."""
    group = command.add_argument_group("structure and priors")
    group.add_argument("--na", type=int, help="denominator coefficients")
    group.add_argument("--nb", type=int, help="numerator coefficients")
    group.add_argument("--nk", type=int, help="delay in samples (0)")
    group.add_argument("--offset", action="store_true", help="an unknown constant")
    group.add_argument(
        "--common-denominator", action="store_true", help="one for all pairs of channels"
    )
    group.add_argument("--from-rest", action="store_true", help="zero before the record")
    group.add_argument("--stable", action="store_true", help="no poles outside the stable region")
    group.add_argument(
        "--prior", action="append", metavar="PRIOR", help='such as "DCGain(0.9, 1.1)"; repeatable'
    )
    group.add_argument("--dc-gain", type=float, nargs=2, metavar=("LOW", "HIGH"))
    group = command.add_argument_group("another structure by name, instead of --na, --nb and --nk")
    group.add_argument("--structure", metavar="NAME", help=f"one of {', '.join(families())}")
    group.add_argument("--order", type=int, help="of that structure")
    group.add_argument("--degree", type=int, help="of that structure (1)")
    group = command.add_argument_group("continuous time, instead of --na, --nb and --nk")
    group.add_argument(
        "--continuous",
        type=int,
        nargs=2,
        metavar=("N", "M"),
        help="order and degree of the numerator: intervals of a1, a0, b0, ... in powers of s",
    )
    group.add_argument("--method", choices=get_args(Method), help="for derivatives (tustin)")
    group.add_argument(
        "--delta", metavar="BOUND", help="of the discretisation error, or: estimate (0)"
    )
    group.add_argument("--tau", type=float, help="time constant of the method lambda")
    group.add_argument("--hold", choices=get_args(Hold), help="inputs between samples (linear)")


def structure_from(arguments: argparse.Namespace, data: IOData) -> Structure:
    """Build the structure of parsed options, for the channels of a record.

    Raises
    ------
    ModelError
        If options of discrete and continuous time are mixed, or orders are missing.
    """
    _check_mixture(arguments)
    if arguments.structure is not None:
        return _registered(arguments, data)
    initial: Initial = "zero" if arguments.from_rest else "free"
    if arguments.continuous is not None:
        if arguments.common_denominator:
            raise ModelError("--common-denominator: found it, expected it without --continuous")
        n, m = arguments.continuous
        return ContinuousTransferFunction(
            n,
            m,
            method=arguments.method or "tustin",
            delta=_delta(arguments.delta),
            tau=arguments.tau,
            hold=arguments.hold or "linear",
            initial=initial,
            offset=arguments.offset,
        )
    for name in ("na", "nb"):
        if getattr(arguments, name) is None:
            raise ModelError(f"--{name}: found none, expected orders, or --continuous N M")
    return TransferFunction(
        arguments.na,
        arguments.nb,
        arguments.nk or 0,
        data.inputs,
        data.outputs,
        common_denominator=arguments.common_denominator,
        offset=arguments.offset,
        initial=initial,
    )


def _check_mixture(arguments: argparse.Namespace) -> None:
    """Refuse options that another kind of structure would leave aside."""
    continuous, named = arguments.continuous is not None, arguments.structure is not None
    for name in _DISCRETE if continuous else _CONTINUOUS:
        if getattr(arguments, name) is not None:
            where = "without" if continuous else "with"
            raise ModelError(f"--{name}: found a value, expected it {where} --continuous")
    for name in (*_DISCRETE, "continuous") if named else _NAMED:
        if getattr(arguments, name) is not None:
            where = "without" if named else "with"
            raise ModelError(f"--{name}: found a value, expected it {where} --structure")
    for name in _SWITCHES if named else ():
        if getattr(arguments, name):
            option = name.replace("_", "-")
            raise ModelError(f"--{option}: found it, expected it without --structure")


def _registered(arguments: argparse.Namespace, data: IOData) -> Structure:
    """The structure of a name, an order and a degree."""
    if arguments.order is None:
        raise ModelError("--order: found none, expected one with --structure")
    family = family_of(arguments.structure)
    assert family is not None
    channels = data.inputs, data.outputs
    degree = 1 if arguments.degree is None else arguments.degree
    found = family(arguments.order, degree, *channels)
    if degree != 1 and found == family(arguments.order, 1, *channels):
        raise ModelError(f"--degree: found it, but {arguments.structure} has no degree")
    return found


def _delta(given: str | None) -> float | Literal["estimate"]:
    if given == "estimate":
        return "estimate"
    try:
        return float(given or 0.0)
    except ValueError:
        raise ModelError(f"--delta: found {given!r}, expected a number or estimate") from None


if __name__ == "__main__":
    sys.exit(main())
