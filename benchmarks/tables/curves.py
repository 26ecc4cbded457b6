"""What several programs or workers are worth together: profiles, gaps over time, speed-up.

References
----------
E. D. Dolan, J. J. More, Benchmarking optimization software with performance profiles, Math.
Program. 91 (2002) 201-213, equation (1): the share of problems that a program solves within a
factor of the fastest one's time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .groups import OURS, Group
from .text import number, table

__all__ = ["Gap", "gaps_over_time", "profile", "profile_table", "speed_ups", "speed_up_table"]

_FLOOR = 0.01  # CPU seconds: below them, times are noise
_FACTORS = (1.0, 2.0, 4.0, 10.0, 100.0)


@dataclass(frozen=True)
class Gap:
    """The largest gap of one program on one problem, over CPU seconds.

    Parameters
    ----------
    program, problem : str
    seconds, gaps : tuple of float
        Of one step each; a program that tells no steps has one, its end.
    """

    program: str
    problem: str
    seconds: tuple[float, ...]
    gaps: tuple[float, ...]


def profile(groups: Sequence[Group]) -> dict[str, list[float]]:
    """Time of each program over that of the fastest, by problem; inf where gaps stay open.

    Problems that no program closes count for none; programs that close none are left out.
    """
    seconds: dict[str, dict[tuple[str, str], float]] = {}
    for group in groups:
        row = group.first
        if row.variant == "default":
            done = all(each.closed == each.objectives for each in group.rows)
            spent = max(group.middle("cpu_seconds"), _FLOOR) if done else math.inf
            seconds.setdefault(row.solver, {})[group.key] = spent
    keys = dict.fromkeys(key for each in seconds.values() for key in each)
    best = {key: min(each.get(key, math.inf) for each in seconds.values()) for key in keys}
    solved = [key for key in keys if math.isfinite(best[key])]
    return {
        solver: sorted(each.get(key, math.inf) / best[key] for key in solved)
        for solver, each in seconds.items()
        if any(math.isfinite(each.get(key, math.inf)) for key in solved)
    }


def profile_table(groups: Sequence[Group]) -> str:
    """Shares of problems within factors of the fastest time; empty for a single program."""
    ratios = profile(groups)
    if len(ratios) < 2 or not any(ratios.values()):
        return ""
    head = ["closed within x times the fastest", *(f"{f:g}" for f in _FACTORS), "ever"]
    lines = []
    for solver, each in ratios.items():
        shares = [sum(r <= f for r in each) / len(each) for f in (*_FACTORS, 1e300)]
        lines.append([solver, *(f"{100.0 * share:.0f} %" for share in shares)])
    return table(head, lines)


def gaps_over_time(groups: Sequence[Group]) -> list[Gap]:
    """Gaps of the first run of each group: our steps, and the ends of peers."""
    found = []
    for group in groups:
        row = group.first
        traces = [detail.get("trace") or [] for detail in row.details]
        if row.solver == OURS and len(traces) == 1 and traces[0]:
            unit = max(1.0, abs(row.upper)) if math.isfinite(row.upper) else 1.0
            seconds = tuple(float(step[0]) for step in traces[0])
            gaps = tuple((_double(step[2]) - _double(step[1])) / unit for step in traces[0])
            found.append(Gap(row.solver, row.problem, seconds, gaps))
        elif math.isfinite(row.gap) and row.cpu_seconds > 0:
            found.append(Gap(row.solver, row.problem, (row.cpu_seconds,), (row.gap,)))
    return found


def _double(value: float | str) -> float:
    return float(value)


def speed_ups(groups: Sequence[Group]) -> dict[str, dict[int, float]]:
    """Wall time without workers over that with some, where both close all gaps."""
    ours = [g for g in groups if g.first.solver == OURS]
    ours = [g for g in ours if all(row.closed == row.objectives for row in g.rows)]
    alone = {g.key: g.middle("wall_seconds") for g in ours if g.first.variant == "default"}
    found: dict[str, dict[int, float]] = {}
    for group in ours:
        count, _, word = group.first.variant.partition(" ")
        spent = group.middle("wall_seconds")
        if word == "workers" and count.isdigit() and spent > 0 and group.key in alone:
            found.setdefault(group.first.problem, {})[int(count)] = alone[group.key] / spent
    return found


def speed_up_table(groups: Sequence[Group]) -> str:
    """Speed-ups as a table; empty without any."""
    found = speed_ups(groups)
    counts = sorted({count for each in found.values() for count in each})
    lines = [
        [name, *(number(each[count]) if count in each else "" for count in counts)]
        for name, each in found.items()
    ]
    return table(["speed-up", *(f"{count} workers" for count in counts)], lines) if lines else ""
