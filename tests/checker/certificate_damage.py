"""Damaged files: results are changed field by field, by a fixed seed.

``python tests/checker/certificate_damage.py folder count`` prints what the checker says of them.

A damaged result may be accepted only where what it claims is still true. Whether it is follows
from the undamaged result, whose bound is proved and whose point is attained: a lower bound above
the attained value is false, and so is an attained value below the proved bound.
"""

from __future__ import annotations

import copy
import json
import math
import random
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent.parent)]

from checker import result  # noqa: E402
from checker.files import reading  # noqa: E402

CLAIMS = ("lower_bound", "upper_bound", "status", "certificate", "attained")
Place = tuple[Any, str | int]  # a container and a key of it


def places(found: Any) -> Iterator[Place]:
    """Every field of what a result claims, in the order of the file."""
    stack: list[Any] = [found]
    top = True
    while stack:
        inside = stack.pop()
        keys = list(inside) if isinstance(inside, dict) else range(len(inside))
        for key in keys:
            if top and key not in CLAIMS:
                continue
            yield inside, key
            if isinstance(inside[key], (dict, list)):
                stack.append(inside[key])
        top = False


def number(value: float, chance: random.Random) -> Any:
    """Another number, near or far."""
    near = math.nextafter(value, math.inf), math.nextafter(value, -math.inf)
    far = (-value, 2 * value, value / 2, value + 1.0, value - 1.0, 0.0, 1e308, -1e308, 1e-300)
    return chance.choice([*near, value * (1 + 1e-9), value * (1 - 1e-6), *far, "inf", "-inf"])


def changed(value: Any, chance: random.Random) -> Any:
    """Another value for a field."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return chance.choice([value + 1, value - 1, -value, 0, 2**31, value + 0.5, 10**30])
    if isinstance(value, float):
        return number(value, chance)
    if isinstance(value, str):
        if value in ("inf", "-inf"):
            return chance.choice([0.0, -1e308, 1e308, "nan"])
        return chance.choice([value + "x", "", "Identity", "OPTIMAL", "INFEASIBLE", "UNBOUNDED", 3])
    if isinstance(value, list) and value:
        return other_list(value, chance)
    return chance.choice([None, [], {}, 0, "x", -1e6, [0, 0.0]])


def other_list(value: list, chance: random.Random) -> list:
    """Another list: shorter, longer, in another order, with a hole, or empty."""
    kept = copy.deepcopy(value)
    place = chance.randrange(len(kept))
    action = chance.randrange(5)
    if action == 0:
        del kept[place]
    elif action == 1:
        kept.append(copy.deepcopy(kept[place]))
    elif action == 2:
        chance.shuffle(kept)
    elif action == 3:
        kept[place] = None
    return [] if action == 4 else kept


def _is_kind(place: Place, kind: float) -> bool:
    """Mostly numbers in arrays, then numbers elsewhere, then anything with a name."""
    inside, key = place
    scalar = isinstance(inside[key], (int, float)) or inside[key] in ("inf", "-inf")
    if kind < 0.5:
        return scalar and isinstance(inside, list)
    return scalar and isinstance(inside, dict) if kind < 0.75 else isinstance(inside, dict)


def damaged(found: Any, chance: random.Random) -> tuple[Any, str]:
    """A copy of a result with one to three fields changed or removed, and what was done."""
    other = copy.deepcopy(found)
    done = []
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        every = list(places(other))
        if not every:  # all is gone
            break
        kind = chance.random()
        chosen = [p for p in every if _is_kind(p, kind)] or every
        inside, key = chance.choice(chosen)
        if chance.random() < 0.08:
            del inside[key]
            done.append(f"{key} removed")
        else:
            before = inside[key]
            inside[key] = changed(before, chance)
            done.append(f"{key}: {before!r:.30} -> {inside[key]!r:.30}")
    return other, "; ".join(done)


def raised(found: Any, chance: random.Random) -> tuple[Any, str]:
    """A copy that claims more than it proves, on top of a change of the argument."""
    other, done = damaged(found, chance)
    amount = chance.choice([1e-9, 1e-3, 1.0])
    low, high = (isinstance(found[k], float) for k in ("lower_bound", "upper_bound"))
    if low and chance.random() < 0.7:
        other["lower_bound"] = found["lower_bound"] + amount * (1 + abs(found["lower_bound"]))
        if isinstance(other.get("certificate"), list) and other["certificate"]:
            last = other["certificate"][-1]
            if isinstance(last, dict):
                last["bound"] = other["lower_bound"]
    elif high:
        other["upper_bound"] = found["upper_bound"] - amount * (1 + abs(found["upper_bound"]))
        if isinstance(other.get("attained"), dict):
            other["attained"]["value"] = other["upper_bound"]
    return other, done + "; raised"


def false_claim(found: Any, other: Any) -> str:
    """Which claim of an accepted damaged result contradicts the undamaged one; empty if none."""
    low, high = (float(found[k]) for k in ("lower_bound", "upper_bound"))
    new_low, new_high = (float(other[k]) for k in ("lower_bound", "upper_bound"))
    if new_low > high:
        return f"objective >= {new_low}, but {high} is attained"
    if other["attained"] is not None and new_high < low:
        return f"{new_high} is attained, but objective >= {low}"
    for status in ("INFEASIBLE", "UNBOUNDED"):
        if other["status"] == status != found["status"]:
            return f"status {status}"
    return ""


def verdict(problem: reading.Problem, other: Any) -> str:
    """What the checker says: accepted, refused (not proved) or malformed."""
    try:
        result.check_result(other, problem)
    except result.NotProved:
        return "refused"
    except reading.Malformed:
        return "malformed"
    except (RecursionError, MemoryError):
        return "malformed"
    return "accepted"


class TooSlow(Exception):
    """A damaged file that takes more than a minute."""


def _alarm(*_: object) -> None:
    raise TooSlow


def attack(paths: list[Path], count: int, seed: int = 0) -> tuple[Counter[str], list[str]]:
    """Damage ``count`` copies in all; what was said, and every false claim that was accepted."""
    signal.signal(signal.SIGALRM, _alarm)
    said: Counter[str] = Counter()
    wrong = []
    for number_ in range(count):
        path = paths[number_ % len(paths)]
        chance = random.Random(f"{seed} {path.name} {number_}")
        found = json.loads(path.read_text())["result"]
        problem = reading.problem(found["problem"])
        other, done = (raised if number_ % 3 == 0 else damaged)(found, chance)
        signal.alarm(60)
        try:
            word = verdict(problem, other)
        except Exception as error:
            word = f"crash: {type(error).__name__}"
            wrong.append(f"{path.name}: {error!r} ({done})")
        signal.alarm(0)
        said[word] += 1
        why = false_claim(found, other) if word == "accepted" else ""
        if why:
            wrong.append(f"{path.name}: {why} ({done})")
    return said, wrong


if __name__ == "__main__":
    files = sorted(Path(sys.argv[1]).glob("*.json"))
    counts, lies = attack(files, int(sys.argv[2]))
    print(dict(counts))
    print(*lies, sep="\n")
    sys.exit(len(lies) > 0)
