"""From JSON lines to a Markdown report: medians over repetitions, then over seeds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from statistics import median

from sparsepop_py.verified.arithmetic.display import rounded

from ..measuring.records import PHASES, Row
from ..peers.environments import may_be_published
from .curves import profile_table, speed_up_table
from .groups import OURS, Group, exponent, groups_of, series_of
from .orders import order_table
from .text import number, table

__all__ = ["publishable", "report"]


def report(rows: Sequence[Row], pictures: Sequence[str] = ()) -> str:
    """The report in Markdown.

    Parameters
    ----------
    rows : sequence of Row
    pictures : sequence of str
        File names to be shown at the end.
    """
    parts = ["# Measurements", _origin(rows)]
    families: dict[str, list[Row]] = {}
    for row in rows:
        families.setdefault(row.family, []).append(row)
    for name, each in families.items():
        parts.append(f"## {name}")
        parts += _family_parts(name, each)
    parts += [f"![{name}]({name})" for name in pictures]
    return "\n\n".join(part for part in parts if part) + "\n"


def publishable(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """Rows that may be published, and the programs whose licences forbid theirs."""
    kept = [row for row in rows if may_be_published(row.solver)]
    return kept, sorted({row.solver for row in rows if not may_be_published(row.solver)})


def _origin(rows: Sequence[Row]) -> str:
    """Commits and versions of all rows."""
    commits = ", ".join(sorted({row.commit for row in rows}))
    seen = {f"{name} {version}" for row in rows for name, version in row.versions.items()}
    return (
        f"{len(rows)} rows; commit {commits}; {', '.join(sorted(seen))}. CPU seconds, medians "
        "over repetitions and seeds; the phase parse is not counted in CPU s."
    )


def _family_parts(name: str, rows: Sequence[Row]) -> Iterator[str]:
    if name == "orders":
        yield order_table(rows)
        return
    groups = groups_of(rows)
    if name == "random":
        yield _soundness(groups)
        return
    if name.startswith("identify"):
        yield _intervals(rows)
    yield _results(groups)
    yield _comparison(groups)
    yield profile_table(groups)
    yield _contradictions(rows)
    yield speed_up_table(groups)
    yield _phases(groups)
    yield _growth(groups)
    yield _ablation(groups)


def _results(groups: Sequence[Group]) -> str:
    head = ["problem", "n", "m", "by", "variant", "runs", "status", "lower", "upper", "worst gap"]
    head += ["closed", "order", "block", "CPU s", "verify s", "part/data", "peak MB", "holds"]
    return table(head, [_result_cells(group) for group in groups])


def _result_cells(group: Group) -> list[str]:
    row = group.first
    single = len({(r.lower, r.upper) for r in group.rows if r.seed == row.seed}) == 1
    single = single and len({r.seed for r in group.rows}) == 1 and not math.isnan(row.lower)
    data = row.problem_bytes * row.certificate_parts
    share = row.certificate_bytes / data if data else math.nan
    return [
        f"{row.problem}",
        str(row.variables),
        str(row.constraints),
        row.solver,
        row.variant if row.variant != "default" else "",
        str(len(group.rows)),
        group.status,
        rounded(row.lower, False, 8) if single else "",
        rounded(row.upper, True, 8) if single else "",
        number(group.worst("gap")) if row.status != "built" else "",
        group.closed if row.status != "built" else "",
        str(row.order or ""),
        str(row.largest_block or ""),
        number(group.middle("cpu_seconds"), 3),
        number(group.middle("verify_seconds")),
        number(share) if share else "",
        f"{group.worst('peak_mb'):.0f}",
        group.valid,
    ]


def _comparison(groups: Sequence[Group]) -> str:
    """Our time over each peer's, where both ran."""
    ours = {g.key: g for g in groups if g.first.solver == OURS and g.first.variant == "default"}
    pairs = [(ours[g.key], g) for g in groups if g.first.solver != OURS and g.key in ours]
    if not pairs:
        return ""
    head = ["problem", "peer", "our s", "peer s", "peer / ours", "our gap", "peer gap"]
    head += ["our closed", "peer closed", "worst violation", "share above 1e-9", "peer status"]
    lines = []
    for own, peer in pairs:
        seconds = own.middle("cpu_seconds"), peer.middle("cpu_seconds")
        lines.append(
            [
                own.first.problem,
                peer.first.solver,
                *(number(s, 3) for s in seconds),
                number(seconds[1] / seconds[0] if seconds[0] > 0 else math.nan),
                number(own.worst("gap")),
                number(peer.worst("gap")),
                own.closed,
                peer.closed,
                number(peer.worst("violation")),
                number(peer.middle("violated")),
                peer.status,
            ]
        )
    return table(head, lines)


def _contradictions(rows: Sequence[Row]) -> str:
    """Where bounds or points of peers contradict what is proved."""
    said = [
        f"- {row.problem}, seed {row.seed}, {row.solver}: {note}"
        for row in rows
        for note in row.notes
        if row.solver != OURS and ("below a proved bound" in note or "above an attained" in note)
    ]
    return "\n".join(["Peers against proved bounds:", "", *said]) if said else ""


def _phases(groups: Sequence[Group]) -> str:
    ours = [g for g in groups if g.first.solver == OURS and g.first.phases]
    if not ours:
        return ""
    used = [name for name in PHASES if any(g.phase(name) >= 5e-4 for g in ours)]
    lines = [
        [g.first.problem, str(g.first.size or ""), g.first.variant]
        + [f"{g.phase(name):.3f}" for name in used]
        for g in ours
    ]
    return table(["CPU s by phase", "size", "variant", *used], lines)


def _growth(groups: Sequence[Group]) -> str:
    slopes = {name: exponent(each) for name, each in series_of(groups).items()}
    lines = [[name, f"{slope:.2f}"] for name, slope in slopes.items() if not math.isnan(slope)]
    return table(["CPU s ~ size^p", "p"], lines) if lines else ""


def _ablation(groups: Sequence[Group]) -> str:
    """What each variant costs and closes, summed over the problems."""
    ours = [g for g in groups if g.first.solver == OURS]
    names = list(dict.fromkeys(g.first.variant for g in ours))
    if len(names) < 2:
        return ""
    base = [g for g in ours if g.first.variant == names[0]]
    head = ["variant", "closed", "CPU s in all", "time / default", "median gap", "holds"]
    lines = []
    for name in names:
        each = [g for g in ours if g.first.variant == name]
        seconds = sum(g.middle("cpu_seconds") for g in each)
        done = sum(r.closed for g in each for r in g.rows)
        asked = sum(r.objectives for g in each for r in g.rows)
        lines.append(
            [
                name,
                f"{done}/{asked}",
                number(seconds, 3),
                number(seconds / max(1e-9, sum(g.middle("cpu_seconds") for g in base))),
                number(median(g.worst("gap") for g in each)),
                "NO" if any(g.valid == "NO" for g in each) else "yes",
            ]
        )
    return table(head, lines)


def _intervals(rows: Sequence[Row]) -> str:
    """Identified records: by structure and noise over all sizes, by size, and all together."""
    lines: dict[str, list[Row]] = {}
    for row in rows:
        words = [word for word in row.problem.split() if not word.startswith("N=")]
        lines.setdefault(" ".join(words), []).append(row)
    for row in rows:
        lines.setdefault(f"N={row.size}", []).append(row)
    lines["all"] = list(rows)
    head = ["records", "runs", "claims hold", "finite", "proved unbounded", "ends closed", "CPU s"]
    head += ["SCIP: runs", "its ends closed", "its CPU s", "its CPU s / ours"]
    refuted = [f"- {r.problem}, seed {r.seed}: {note}" for r in rows if r.valid is False
               for note in r.notes or (r.status,)]  # fmt: skip
    shown = table(head, [_interval_cells(name, each) for name, each in lines.items()])
    return "\n\n".join(part for part in (shown, "\n".join(refuted)) if part)


def _interval_cells(name: str, rows: Sequence[Row]) -> list[str]:
    ours = [row for row in rows if row.solver == OURS]
    peers = [row for row in rows if row.solver != OURS]
    finite = sum(
        bool(r.details) and all(math.isfinite(d["lower"]) for d in r.details) for r in ours
    )
    seconds = {(row.problem, row.seed): row.cpu_seconds for row in ours}
    ratios = [r.cpu_seconds / seconds.get((r.problem, r.seed), math.nan) for r in peers]
    return [
        name,
        str(len(ours)),
        f"{sum(row.valid is True for row in ours)}",
        str(finite),
        str(sum(row.status.startswith("unbounded") for row in ours)),
        _share(ours),
        number(_middle([row.cpu_seconds for row in ours]), 3),
        str(len(peers)),
        _share(peers),
        number(_middle([row.cpu_seconds for row in peers]), 3),
        number(_middle(ratios)),
    ]


def _share(rows: Sequence[Row]) -> str:
    """Closed ends in per cent of those that are not proved to be infinite."""
    asked = sum(row.objectives for row in rows if not row.status.startswith("unbounded"))
    return f"{100.0 * sum(row.closed for row in rows) / asked:.0f} %" if asked else ""


def _middle(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return median(known) if known else math.nan


def _soundness(groups: Sequence[Group]) -> str:
    """Random problems: findings, disagreements with SCIP, and the share of finite bounds."""
    merged: dict[tuple[str, str], list[Row]] = {}
    for group in groups:
        merged.setdefault((group.first.problem, group.first.solver), []).extend(group.rows)
    head = ["kind", "by", "problems", "finite bounds", "closed", "refuted", "errors", "CPU s"]
    lines = []
    for (kind, solver), rows in merged.items():
        count = len(rows)
        finite = sum(math.isfinite(row.lower) for row in rows)
        lines.append(
            [
                kind,
                solver,
                str(count),
                f"{100.0 * finite / count:.1f} %",
                f"{100.0 * sum(row.closed for row in rows) / count:.1f} %",
                str(sum(row.valid is False for row in rows)),
                str(sum(row.status.startswith("error") for row in rows)),
                number(sum(r.cpu_seconds for r in rows if not math.isnan(r.cpu_seconds)), 3),
            ]
        )
    refuted = [
        f"- {row.problem}, seed {row.seed}, {row.solver}: {note}"
        for rows in merged.values()
        for row in rows
        if row.valid is False
        for note in row.notes or (row.status,)
    ]
    return "\n\n".join(part for part in (table(head, lines), "\n".join(refuted)) if part)
