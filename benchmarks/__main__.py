"""The command line: ``python -m benchmarks {list,run,ablation,report,orders,...}``."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import sparsepop_py as sp

from .errors import BenchmarkError
from .measuring.measure import Setting
from .measuring.records import Row, read_rows, write_row
from .measuring.registry import Selection
from .measuring.settings import parsed, switches
from .peers.environments import PEERS, make
from .problems.attack import attack
from .problems.families import REGISTRY
from .runner import SOLVERS, ablation, run
from .tables.auto_beside_plain import auto_beside_plain, beside_table, files_of, members_of
from .tables.limits import CASES, limits_table, measure_limits
from .tables.orders import compare, order_table
from .tables.pictures import draw_orders, draw_report
from .tables.published import published_tables
from .tables.report import publishable, report
from .tables.sizes import compare_sizes, read_reference, sizes_table
from .tables.text import number, table
from .tables.walks import walks

__all__ = ["main"]

_RESULTS = Path(__file__).resolve().parent / "results"
_EXIT_WRONG, _EXIT_MISSING = 2, 3


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when done, 2 when the input is wrong, 3 when software is missing."""
    chosen = _parser().parse_args(argv)
    try:
        chosen.act(chosen)
    except (BenchmarkError, sp.FormatError, sp.ProblemError) as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return _EXIT_WRONG
    except sp.SolverNotFound as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return _EXIT_MISSING
    return 0


# ---- commands ---------------------------------------------------------------------------


def _list(chosen: argparse.Namespace) -> None:
    print(table(["family", "what it holds"], [[f.name, f.summary] for f in REGISTRY]))
    print(f"\nswitches for ablation: {', '.join(switches()) or 'none'}")


def _run(chosen: argparse.Namespace) -> None:
    families = [REGISTRY[name] for name in chosen.families]
    resume = chosen.resume and chosen.output.exists()
    stored = list(read_rows([chosen.output])) if resume else []
    _keep(run(families, _selection(chosen), _setting(chosen), stored), chosen.output, bool(stored))


def _ablation(chosen: argparse.Namespace) -> None:
    families = [REGISTRY[name] for name in chosen.families]
    names = list(switches()) if chosen.switches is None else chosen.switches
    rows = ablation(families, _selection(chosen), _setting(chosen), names, chosen.variant)
    _keep(rows, chosen.output)


def _keep(rows: Iterable[Row], path: Path, resumed: bool = False) -> None:
    """Write rows as they come, and show each in a line."""
    count = 0
    for row in rows:
        write_row(row, path)
        if not count:
            print(table(["problem", "seed", "by", "status", "closed", "gap", "CPU s"], []))
        count += 1
        print(table(_short(row), []).splitlines()[0], flush=True)
        for note in row.notes if row.valid is False else ():
            print(f"    {note}", flush=True)
    if not count and resumed:
        print(f"nothing is left to measure for {path}")
        return
    if not count:
        raise BenchmarkError("--names: nothing is selected, expected part of a problem's name")
    print(f"\n{count} rows were added to {path}")


def _short(row: Row) -> list[str]:
    size = f" [{row.size}]" if row.size and str(row.size) not in row.problem else ""
    by = row.solver + (f", {row.variant}" if row.variant != "default" else "")
    gap = "" if row.status == "built" else number(row.gap)
    seconds = "" if math.isnan(row.cpu_seconds) else f"{row.cpu_seconds:.3f}"
    done = f"{row.closed}/{row.objectives}"
    return [row.problem + size, str(row.seed), by, row.status, done, gap, seconds]


def _soundness(chosen: argparse.Namespace) -> None:
    *found, counts = attack(chosen.minutes, chosen.first)
    print("\n".join([*found, counts]))
    if found:
        raise BenchmarkError(f"{len(found)} contradictions")


def _environments(chosen: argparse.Namespace) -> None:
    for line in make(chosen.names or list(PEERS)):
        print(line, flush=True)


def _report(chosen: argparse.Namespace) -> None:
    rows = list(read_rows(chosen.files))
    if not rows:
        raise BenchmarkError("FILE: found no rows, expected JSON lines that `run` wrote")
    rows, left_out = (rows, []) if chosen.unpublished else publishable(rows)
    if left_out:
        print(f"left out, since their licences forbid it: {', '.join(left_out)}\n")
    pictures = [] if chosen.no_plots else draw_report(rows, chosen.output)
    text = report(rows, [path.name for path in pictures])
    chosen.output.mkdir(parents=True, exist_ok=True)
    path = chosen.output / "report.md"
    path.write_text(text, encoding="utf-8")
    print(text)
    print(f"written: {', '.join(str(each) for each in [path, *pictures])}")


def _orders(chosen: argparse.Namespace) -> None:
    settings = {"effort": chosen.effort, **parsed(chosen.set)}
    if chosen.limit is not None:
        settings["time_limit"] = chosen.limit
    rows = list(compare(chosen.files, chosen.orders, chosen.sparse, settings, chosen.repeat))
    print(order_table(rows))
    for row in rows:
        write_row(row, chosen.output / "orders.jsonl")
    pictures = [] if chosen.no_plots else draw_orders(rows, chosen.output)
    written = [chosen.output / "orders.jsonl", *pictures]
    print(f"\nwritten: {', '.join(str(path) for path in written)}")


def _sizes(chosen: argparse.Namespace) -> None:
    files = [f for each in chosen.files for f in (_gms(each) if each.is_dir() else [each])]
    if not files:
        raise BenchmarkError("FILE: found no .gms files, expected some or a folder of them")
    reference = read_reference(chosen.reference) if chosen.reference else {}
    print(sizes_table(list(compare_sizes(files, reference, not chosen.no_solve))))


def _times(chosen: argparse.Namespace) -> None:
    if not chosen.folder.is_dir():
        raise BenchmarkError(f"{chosen.folder}: found no folder, expected one of .gms files")
    for line in published_tables(chosen.folder, chosen.names, chosen.repeat):
        print(line, flush=True)


def _limits(chosen: argparse.Namespace) -> None:
    if chosen.list:
        print("\n".join(CASES))
        return
    found = []
    for each in measure_limits(chosen.names, chosen.limits, chosen.busy):
        print(f"{each.case}: {each.wall:.1f} s of {each.limit:g} s, {each.status}", flush=True)
        found.append(each)
    print(f"\n{limits_table(found)}")


def _auto(chosen: argparse.Namespace) -> None:
    files = [f for each in chosen.files for f in (_gms(each) if each.is_dir() else [each])]
    problems = files_of(files)
    for name in chosen.families:
        problems += members_of(REGISTRY[name], chosen.names)
    if not problems:
        raise BenchmarkError("FILE, --families: found no problems, expected some")
    found = []
    for each in auto_beside_plain(problems, chosen.orders, chosen.limit, chosen.repeat):
        print(f"{each.name} order {each.order}: {'reached' if each.reached else 'NOT reached'}")
        found.append(each)
    print(f"\n{beside_table(found)}")


def _walks(chosen: argparse.Namespace) -> None:
    print(walks())


def _gms(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.gms"))


# ---- arguments --------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    listing = commands.add_parser("list", help="name the families and the switches")
    listing.set_defaults(act=_list)
    _run_parser(commands.add_parser("run", help="measure families, beside SCIP"))
    _ablation_parser(commands.add_parser("ablation", help="measure with one switch off in turn"))
    making = commands.add_parser("environments", help="make the environments of peers")
    making.add_argument("names", nargs="*", metavar="PEER", help="all when left out")
    making.set_defaults(act=_environments)
    _report_parser(commands.add_parser("report", help="tables and pictures of JSON lines"))
    _orders_parser(commands.add_parser("orders", help="compare relaxation orders on .gms files"))
    _sizes_parser(
        commands.add_parser(
            "sparsepop_sizes", help="sizes of plain relaxations, beside SparsePOP's"
        )
    )
    _times_parser(
        commands.add_parser("sparsepop_times", help="times beside those SparsePOP published")
    )
    _limits_parser(commands.add_parser("limits", help="wall time over time limits, under load"))
    _auto_parser(commands.add_parser("auto", help="effort auto beside plain orders"))
    sound = commands.add_parser("soundness", help="random problems with planted answers")
    sound.add_argument("--minutes", type=float, default=60.0, help="CPU time; 60")
    sound.add_argument("--first", type=int, default=0, help="seed of the first problem; 0")
    sound.set_defaults(act=_soundness)
    walking = commands.add_parser("walks", help="folders, imports, traces and words of the code")
    walking.set_defaults(act=_walks)
    return parser


def _times_parser(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="with files such as Bex2_1_2.gms"
    )
    parser.add_argument("--names", nargs="+", default=[], help="only these rows, ex2_1_2 and so on")
    parser.add_argument(
        "--repeat", type=int, default=2, help="the least of them, default %(default)s"
    )
    parser.set_defaults(act=_times)


def _auto_parser(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.gms or FOLDER")
    parser.add_argument("--families", nargs="+", default=[], help="also problems of these, as zoo")
    parser.add_argument("--names", nargs="+", default=[], help="of families, only such members")
    parser.add_argument(
        "--orders", nargs="+", type=int, default=[1, 2, 3], help="default: %(default)s"
    )
    parser.add_argument("--repeat", type=int, default=1, help="medians of so many, default 1")
    parser.add_argument(
        "--limit",
        type=float,
        default=60.0,
        help="CPU seconds a plain order, default %(default)s",
    )
    parser.set_defaults(act=_auto)


def _limits_parser(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--list", action="store_true", help="name the cases and do nothing else")
    add("--names", nargs="+", default=[], help="only cases whose name contains one of these")
    add("--limits", nargs="+", type=float, default=[5.0, 20.0], help="seconds, default 5 20")
    add("--busy", type=int, default=4, help="busy processes beside it, default %(default)s")
    parser.set_defaults(act=_limits)


def _sizes_parser(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.gms or FOLDER")
    parser.add_argument("--reference", type=Path, help="a .csv table of SparsePOP's sizes")
    parser.add_argument("--no-solve", action="store_true", help="sizes alone")
    parser.set_defaults(act=_sizes)


def _run_parser(parser: argparse.ArgumentParser) -> None:
    _add_selection(parser, "run.jsonl")
    parser.add_argument(
        "--solvers", nargs="+", default=list(SOLVERS), metavar="NAME", help=_solvers_help()
    )
    parser.add_argument(
        "--resume", action="store_true", help="leave out what the output file holds already"
    )
    parser.add_argument(
        "--workers", nargs="+", type=int, default=[], help="also with so many worker processes"
    )
    parser.set_defaults(act=_run)


def _solvers_help() -> str:
    return f"default %(default)s; others are {', '.join(name for name in PEERS if name != 'scip')}"


def _ablation_parser(parser: argparse.ArgumentParser) -> None:
    _add_selection(parser, "ablation.jsonl")
    parser.add_argument(
        "--switches", nargs="*", metavar="NAME", help="which to switch off; all when left out"
    )
    parser.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="NAME:FIELD=VALUE,...",
        help="one more variant, by fields of Options",
    )
    parser.set_defaults(act=_ablation, solvers=["sparsepop_py"])


def _report_parser(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        default=[_RESULTS / "run.jsonl"],
        help="JSON lines of `run`, default where it writes them",
    )
    parser.add_argument("--no-plots", action="store_true", help="tables alone")
    parser.add_argument(
        "--unpublished",
        action="store_true",
        help="also figures of programs whose licences forbid to publish them: for yourself",
    )
    _add_folder(parser)
    parser.set_defaults(act=_report)


def _orders_parser(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.gms")
    parser.add_argument(
        "--orders", nargs="+", type=int, default=[1, 2, 3], help="default: %(default)s"
    )
    parser.add_argument(
        "--sparse",
        choices=["both", "sparse", "dense"],
        default="both",
        help="one clique of all variables (dense), cliques of the problem, or both (default)",
    )
    parser.add_argument(
        "--effort",
        choices=["plain", "presolve", "auto"],
        default="plain",
        help="plain (default): exactly the relaxation of that order",
    )
    parser.add_argument("--repeat", type=int, default=1, help="repetitions, default %(default)s")
    parser.add_argument("--limit", type=float, help="seconds for each solve, default none")
    parser.add_argument("--no-plots", action="store_true", help="the table alone")
    _add_set(parser)
    _add_folder(parser)
    parser.set_defaults(act=_orders)


def _add_selection(parser: argparse.ArgumentParser, name: str) -> None:
    parser.add_argument("families", nargs="+", metavar="FAMILY", help="see `list`")
    add = parser.add_argument
    add("--names", nargs="+", default=[], help="only problems whose name contains one of these")
    add("--sizes", nargs="+", type=int, default=[], help="samples or variables")
    add("--noise", nargs="+", type=float, default=[], help="factors on the noise, default 1 5")
    add("--seeds", nargs="+", type=int, default=[0], help="default 0")
    add("--files", nargs="+", type=Path, default=[], help="problems of the family files")
    add("--count", type=int, default=2000, help="random problems a seed, default %(default)s")
    add("--repeat", type=int, default=3, help="repetitions, default %(default)s")
    add("--effort", choices=["plain", "presolve", "auto"], help="instead of the family's own")
    add("--order", type=int, help="relaxation order, or where auto starts")
    add("--gap", type=float, help="gap that counts as closed; of the width for oe and eiv")
    add("--limit", type=float, default=60.0, help="our seconds a solve, default %(default)s")
    add("--peer-limit", type=float, help="a peer's CPU seconds an objective, default 60, random 2")
    add("--output", type=Path, default=_RESULTS / name, help="JSON lines, default %(default)s")
    _add_set(parser)


def _add_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="FIELD=VALUE", help="further fields of Options"
    )


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", type=Path, default=_RESULTS, help="folder, default %(default)s")


def _selection(chosen: argparse.Namespace) -> Selection:
    for size in chosen.sizes:
        if size < 1:
            raise BenchmarkError(f"--sizes: found {size}, expected positive integers")
    for seed in chosen.seeds:
        if seed < 0:
            raise BenchmarkError(f"--seeds: found {seed}, expected integers >= 0")
    return Selection(
        names=tuple(chosen.names),
        sizes=tuple(chosen.sizes),
        seeds=tuple(chosen.seeds),
        noises=tuple(chosen.noise),
        files=tuple(chosen.files),
        count=chosen.count,
    )


def _setting(chosen: argparse.Namespace) -> Setting:
    given = {
        "effort": chosen.effort,
        "order": chosen.order,
        "gap": chosen.gap,
        "time_limit": chosen.limit,
    }
    options = {name: value for name, value in given.items() if value is not None}
    return Setting(
        tuple(chosen.solvers),
        chosen.repeat,
        options | parsed(chosen.set),
        chosen.peer_limit,
        workers=tuple(getattr(chosen, "workers", ())),
    )


if __name__ == "__main__":
    sys.exit(main())
