"""Pictures of measurements; colours are those of Okabe and Ito."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sparsepop_py.plots import require_matplotlib

from ..measuring.records import PHASES, Row
from .curves import gaps_over_time, profile, speed_ups
from .groups import OURS, Group, exponent, groups_of, series_of

__all__ = ["draw_orders", "draw_report"]

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
_GREY = "#BBBBBB"
_MOST_BARS = 40


def draw_report(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Pictures of all families in a folder: growth, phases, and our times beside a peer's.

    Raises
    ------
    SolverNotFound
        If matplotlib is missing.
    """
    _prepare(folder)
    made = []
    families: dict[str, list[Row]] = {}
    for row in rows:
        families.setdefault(row.family, []).append(row)
    for name, each in families.items():
        if name == "orders":
            made += draw_orders(each, folder)
        elif name != "random":
            groups = groups_of(each)
            for word, draw in _DRAWN:
                path = folder / f"{name}_{word}.png"
                if draw(name, groups, path):
                    made.append(path)
    return made


def _prepare(folder: Path) -> None:
    require_matplotlib()
    folder.mkdir(parents=True, exist_ok=True)


def _figure(width: float = 7.0, height: float = 5.0, columns: int = 1) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(1, columns)


def _growth(family: str, groups: Sequence[Group], path: Path) -> bool:
    """CPU seconds against size, where there are several sizes."""
    series = {name: each for name, each in series_of(groups).items() if len(each) > 1}
    if not series:
        return False
    figure, ax = _figure()
    for (name, each), colour in zip(series.items(), _COLOURS * 9, strict=False):
        points = sorted((g.first.size or 0, g.middle("cpu_seconds")) for g in each)
        power = exponent(each)
        label = name if math.isnan(power) else f"{name}, size^{power:.2f}"
        ax.loglog(*zip(*points, strict=True), "o-", color=colour, label=label)
    ax.set_xlabel("size")
    ax.set_ylabel("CPU seconds")
    ax.set_title(f"{family}: growth")
    ax.grid(True, color=_GREY, alpha=0.4)
    ax.legend()
    figure.savefig(path, dpi=150)
    return True


def _phases(family: str, groups: Sequence[Group], path: Path) -> bool:
    """Stacked bars of CPU seconds by phase, the dearest problems first."""
    ours = [g for g in groups if g.first.solver == OURS and g.first.phases]
    ours.sort(key=lambda g: -sum(g.phase(name) for name in PHASES))
    ours = ours[:_MOST_BARS]
    if not ours:
        return False
    figure, ax = _figure(8.0, 1.6 + 0.24 * len(ours))
    places, left = list(range(len(ours))), [0.0] * len(ours)
    for name, colour in zip(PHASES, (*_COLOURS, "#882255", _GREY), strict=True):
        widths = [g.phase(name) for g in ours]
        if any(widths):
            ax.barh(places, widths, left=left, color=colour, label=name)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    ax.set_yticks(places, [_label(g) for g in ours])
    ax.invert_yaxis()
    ax.set_xlabel("CPU seconds")
    ax.set_title(f"{family}: phases")
    figure.legend(loc="outside right upper")
    figure.savefig(path, dpi=150)
    return True


def _label(group: Group) -> str:
    row = group.first
    size = f" {row.size}" if row.size and str(row.size) not in row.problem else ""
    variant = f", {row.variant}" if row.variant != "default" else ""
    return f"{row.problem}{size}{variant}"


def _peers(family: str, groups: Sequence[Group], path: Path) -> bool:
    """Our CPU seconds against a peer's, one mark a problem; hollow where one is not closed."""
    ours = {g.key: g for g in groups if g.first.solver == OURS and g.first.variant == "default"}
    pairs = [(ours[g.key], g) for g in groups if g.first.solver != OURS and g.key in ours]
    points = [(p.middle("cpu_seconds"), o.middle("cpu_seconds"), o, p) for o, p in pairs]
    points = [point for point in points if point[0] > 0 and point[1] > 0]
    if not points:
        return False
    figure, ax = _figure()
    for x, y, own, peer in points:
        done = all(r.closed == r.objectives for r in own.rows + peer.rows)
        face = _COLOURS[0] if done else "none"
        ax.loglog(x, y, "o", markeredgecolor=_COLOURS[0], markerfacecolor=face)
    ends = [min(min(p[:2]) for p in points) / 2, max(max(p[:2]) for p in points) * 2]
    ax.loglog(ends, ends, "--", color=_GREY, label="equal")
    ax.set_xlabel(f"CPU seconds, {points[0][3].first.solver}")
    ax.set_ylabel(f"CPU seconds, {OURS}")
    ax.set_title(f"{family}: hollow where a gap stays open")
    ax.legend()
    figure.savefig(path, dpi=150)
    return True


# ---- relaxation orders ------------------------------------------------------------------


def draw_orders(rows: Sequence[Row], folder: Path) -> list[Path]:
    """For each problem, proved and attained values and CPU seconds against the order.

    Raises
    ------
    SolverNotFound
        If matplotlib is missing.
    """
    _prepare(folder)
    made = []
    for problem in dict.fromkeys(row.problem for row in rows):
        each = [row for row in rows if row.problem == problem]
        path = folder / f"orders_{re.sub(r'[^A-Za-z0-9]+', '_', problem)}.png"
        _draw_problem(problem, each, path)
        made.append(path)
    return made


def _draw_problem(problem: str, rows: Sequence[Row], path: Path) -> None:
    figure, (left, right) = _figure(10.0, 4.4, 2)
    maximum = any(d.get("sense") == "max" for row in rows for d in row.details)
    sign = -1.0 if maximum else 1.0
    variants = list(dict.fromkeys(row.variant for row in rows))
    for variant, colour, mark in zip(variants, _COLOURS, "osv^D", strict=False):
        groups = [g for g in groups_of(rows) if g.first.variant == variant]
        orders = [g.first.size or 0 for g in groups]
        proved = [_finite(sign * g.first.lower) for g in groups]
        left.plot(orders, proved, f"{mark}-", color=colour, label=f"proved, {variant}", alpha=0.8)
        seconds = [g.middle("cpu_seconds") for g in groups]
        right.semilogy(orders, seconds, f"{mark}-", color=colour, label=variant)
        _name_blocks(right, groups, orders, seconds)
    attained = [row.upper for row in rows if math.isfinite(row.upper)]
    if attained:
        best = sign * min(attained)
        left.axhline(best, color="black", linestyle=":", label="best attained value")
    _open_orders(left, rows)
    left.set_ylabel("value of a maximum" if maximum else "value of a minimum")
    right.set_ylabel("CPU seconds (numbers: largest block)")
    for ax in (left, right):
        ax.set_xlabel("relaxation order")
        ax.set_xticks(sorted({row.size or 0 for row in rows}))
        ax.grid(True, color=_GREY, alpha=0.4)
        ax.legend()
    figure.suptitle(problem)
    figure.savefig(path, dpi=150)


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan


def _name_blocks(ax: Any, groups: list[Group], orders: list[int], seconds: list[float]) -> None:
    for group, x, y in zip(groups, orders, seconds, strict=True):
        text = str(group.first.largest_block)
        ax.annotate(text, (x, y), textcoords="offset points", xytext=(4, 4), fontsize=8)


def _open_orders(ax: Any, rows: Sequence[Row]) -> None:
    """Say where nothing is proved, which a curve cannot show."""
    nothing = sorted({row.size or 0 for row in rows if not math.isfinite(row.lower)})
    if nothing:
        shown = ", ".join(map(str, nothing))
        ax.plot([], [], " ", label=f"no finite bound at order {shown}")


def _profile(family: str, groups: Sequence[Group], path: Path) -> bool:
    """Share of problems closed within a factor of the fastest time, by program."""
    ratios = profile(groups)
    if len(ratios) < 2 or not any(ratios.values()):
        return False
    figure, ax = _figure()
    last = 2.0 * max((r for each in ratios.values() for r in each if r < math.inf), default=1.0)
    for (name, each), colour in zip(ratios.items(), _COLOURS * 9, strict=False):
        ends = [r for r in each if r < math.inf]
        heights = [(k + 1) / len(each) for k in range(len(ends))]
        xs, ys = [1.0, *ends, last], [0.0, *heights, heights[-1] if heights else 0.0]
        ax.semilogx(xs, ys, drawstyle="steps-post", color=colour, label=name)
    ax.set_xlabel("CPU seconds over those of the fastest")
    ax.set_ylabel("share of problems closed")
    ax.set_title(f"{family}: performance profile")
    ax.grid(True, color=_GREY, alpha=0.4)
    ax.legend()
    figure.savefig(path, dpi=150)
    return True


def _gaps(family: str, groups: Sequence[Group], path: Path) -> bool:
    """Gaps over CPU seconds: our steps as lines, ends of peers as marks."""
    found = [gap for gap in gaps_over_time(groups) if any(0 < g < math.inf for g in gap.gaps)]
    if not any(len(gap.gaps) > 1 for gap in found):
        return False
    figure, ax = _figure()
    colours = dict(zip(dict.fromkeys(gap.program for gap in found), _COLOURS * 9, strict=False))
    shown = set[str]()
    for gap in found:
        points = [(t, g) for t, g in zip(gap.seconds, gap.gaps, strict=True) if 0 < g < math.inf]
        label = None if gap.program in shown else gap.program
        shown.add(gap.program)
        style = "o-" if len(gap.gaps) > 1 else "x"
        ax.loglog(*zip(*points, strict=True), style, color=colours[gap.program], label=label)
    ax.set_xlabel("CPU seconds")
    ax.set_ylabel("gap")
    ax.set_title(f"{family}: gap over time")
    ax.grid(True, color=_GREY, alpha=0.4)
    ax.legend()
    figure.savefig(path, dpi=150)
    return True


def _speed_ups(family: str, groups: Sequence[Group], path: Path) -> bool:
    """Speed-up against the number of workers, beside the ideal."""
    found = speed_ups(groups)
    if not found:
        return False
    figure, ax = _figure()
    for (name, each), colour in zip(found.items(), _COLOURS * 9, strict=False):
        ax.plot(*zip(*sorted(each.items()), strict=True), "o-", color=colour, label=name)
    most = max(count for each in found.values() for count in each)
    ax.plot([1, most], [1, most], "--", color=_GREY, label="ideal")
    ax.set_xlabel("workers")
    ax.set_ylabel("wall time without workers over that with")
    ax.set_title(f"{family}: speed-up")
    ax.legend()
    figure.savefig(path, dpi=150)
    return True


_DRAWN = (
    ("growth", _growth),
    ("phases", _phases),
    ("peers", _peers),
    ("profile", _profile),
    ("gaps", _gaps),
    ("speed_up", _speed_ups),
)
