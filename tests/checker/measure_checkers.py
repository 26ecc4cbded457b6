"""Figures about the two checkers: ``python tests/checker/measure_checkers.py folder [damaged]``.

Solves the corpus of problems and identifies the corpus of records, unless the folder holds their
files; lets both checkers look at everything; damages copies field by field. Prints how many of
which kinds were checked, the times, every disagreement, and what was said of damaged files. Ends
with 1 where the checkers disagree or a false claim is accepted.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent.parent)]

import certificate_corpus  # noqa: E402
import certificate_damage  # noqa: E402
import compare_checkers  # noqa: E402
import record_corpus  # noqa: E402

from checker import result  # noqa: E402
from checker.files import reading  # noqa: E402
from checker.records.record import Identification  # noqa: E402
from setid.result.certificate_files import certificate_files  # noqa: E402


def record_verdict(found: Any) -> tuple[str, list[str]]:
    """What the second checker says of an identification, and its lines."""
    try:
        lines = Identification(found).check()
    except result.NotProved as error:
        return f"refused: {error}", []
    except (reading.Malformed, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return "malformed", []
    taken = [line for line in lines if line.startswith("taken as given")]
    return ("but for what is taken as given" if taken else "proved"), lines


def records(folder: Path) -> int:
    """Identify all records, let both checkers look at them, and keep the files."""
    said: Counter[str] = Counter()
    steps: Counter[str] = Counter()
    spent, wrong = [0.0, 0.0], 0
    for case in record_corpus.cases():
        found = record_corpus.identified(case, 8.0)
        begin = time.process_time()
        package = bool(found.verify(case[1]))
        middle = time.process_time()
        file = json.loads(json.dumps(certificate_files(found)))["identification"]
        written = time.process_time()
        word, _ = record_verdict(file)
        spent[0] += middle - begin
        spent[1] += time.process_time() - written
        said[word.split(":")[0]] += 1
        steps.update(step["is"] for step in (file["box"] or {}).get("steps") or ())
        if package != (word[0] in "pb"):
            wrong += 1
            print(f"{case[0]}: package {package}, checker {word}")
        (folder / f"{case[0]}.json").write_text(json.dumps(file))
    print(f"records: {dict(said)}; steps of boxes: {dict(steps)}")
    print(f"seconds: package {spent[0]:.1f}, checker {spent[1]:.1f}; {wrong} disagreements")
    return wrong


def damaged_records(folder: Path, count: int) -> int:
    """Damage the proofs of records; accepted intervals have to hold what is attained."""
    said: Counter[str] = Counter()
    wrong, places = 0, ("problem", "rows", "box", "ends", "linear", "intervals", "units")
    paths = [p for p in sorted(folder.glob("*.json")) if p.stat().st_size < 300_000]
    for number in range(count):
        chance = certificate_damage.random.Random(f"record {number}")
        found = json.loads(paths[number % len(paths)].read_text())
        other = json.loads(json.dumps(found))
        place = chance.choice([key for key in places if other[key]])
        inside = {"certificate": other[place]}
        other[place] = certificate_damage.damaged(inside, chance)[0].get("certificate")
        word, _ = record_verdict(other)
        said[word.split(":")[0]] += 1
        if word[0] in "pb" and not still_true(found, other):
            wrong += 1
            print(f"{paths[number % len(paths)].name} {number}: false, {place} was damaged")
    print(f"damaged records: {count}, {dict(said)}; {wrong} false claims accepted")
    return wrong


def still_true(found: Any, other: Any) -> bool:
    """Whether damaged intervals hold the attained values of the undamaged ones."""
    for old, new in zip(found["intervals"], other["intervals"], strict=True):
        if old["inner"] is not None and new["name"] == old["name"]:
            low, high = (float(v) for v in new["outer"])
            if low > old["inner"][0] or high < old["inner"][1]:
                return False
    return True


def main(folder: Path, damaged: int) -> int:
    """All of it."""
    problems, identified = folder / "problems", folder / "records"
    identified.mkdir(parents=True, exist_ok=True)
    if not problems.exists():
        certificate_corpus.write(problems, list(certificate_corpus.GROUPS))
    wrong = compare_checkers.main(problems)
    said, lies = certificate_damage.attack(sorted(problems.glob("*.json")), damaged)
    print(f"damaged results: {damaged}, {dict(said)}; {len(lies)} false claims or crashes")
    print(*lies, sep="\n")
    return wrong + len(lies) + records(identified) + damaged_records(identified, damaged // 2)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1000) > 0)
