"""Both checkers on the same files: ``python tests/checker/compare_checkers.py folder``."""

from __future__ import annotations

import json
import math
import sys
import time
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent.parent)]

from certificate_corpus import kinds  # noqa: E402

import sparsepop_py as sp  # noqa: E402
from checker import result  # noqa: E402
from checker.certificates.certificate import Certificates  # noqa: E402
from checker.files import reading  # noqa: E402


def ours(found: dict) -> tuple[bool, float, str]:
    """Whether the second checker proves a result, the bound, and what it says."""
    try:
        lines = result.check_result(found)
        about = reading.problem(found["problem"])
        bound = -math.inf
        if found["certificate"] is not None:
            bound = Certificates(found["certificate"], about).prove()[0]
        return True, bound, "; ".join(lines)
    except (result.NotProved, reading.Malformed) as error:
        return False, -math.inf, str(error)


def theirs(text: str) -> tuple[bool, float, str]:
    """Whether the package reads a result, which proves it, and the bound."""
    try:
        read = sp.from_json(text)
    except sp.ProblemError as error:
        return False, -math.inf, str(error)
    proof = read.certificate
    return True, proof.verify(read.problem).bound if proof else -math.inf, ""


def main(folder: Path) -> int:
    """Print what was checked, how long it took, and every disagreement."""
    counts: Counter[str] = Counter()
    spent = {"package": 0.0, "checker": 0.0}
    slow, wrong = [], 0
    paths = sorted(folder.glob("*.json"))
    for path in paths:
        text = path.read_text()
        begin = time.process_time()
        one = theirs(text)
        middle = time.process_time()
        found = json.loads(text)["result"]
        other = ours(found)
        end = time.process_time()
        spent["package"] += middle - begin
        spent["checker"] += end - middle
        slow.append((end - middle, middle - begin, path.name))
        for kind in kinds(found):
            counts[kind] += 1
        counts["results"] += 1
        if one[0] != other[0] or not other[1] >= one[1]:
            wrong += 1
            print(f"{path.name}: package {one}, checker {other}")
    for kind, count in sorted(counts.items(), key=lambda pair: -pair[1]):
        print(f"{count:6d}  {kind}")
    print(f"seconds, each twice: {spent}; {wrong} disagreements")
    for mine, other, name in sorted(slow, reverse=True)[:8]:
        print(f"  {mine:.2f} against {other:.2f}  {name}")
    return wrong


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])) > 0)
