"""Run the tests of each room against deliberate faults in the code that proves.

A fault ("mutant") is one snippet of a source file and what it is replaced by, for instance a
rounding in the wrong direction or a check that is left out. Each is tried in a copy of the
package, never in the work tree, with the fast tests of its room: the first test file alone,
which finds most faults, then the others together. A fault that no test notices is a survivor.
It needs a test, or in the list a sentence that proves it harmless.

Usage: python tests/mutants/run.py [--workers 2] [--minutes M] [--only WORD] [--again] [LIST ...]

A list is a table of sources, each with its tests and its faults:

    [[source]]
    file = "sparsepop_py/verified/arithmetic/interval.py"
    tests = ["tests/verified/arithmetic/test_interval.py"]

    [[source.fault]]
    says = "down rounds nothing"
    find = "return np.nextafter(x, -np.inf)"    # occurs exactly once in the file
    put = "return np.asarray(x, float)"
    harmless = "why no false claim can follow"  # only where no test can notice it

Results are kept in .mutants/results.json as long as the file with the fault, its tests and their
helpers stay as they are, so that an interrupted run goes on where it stopped; --again forgets
them. With --minutes no fault is begun after that time; files take turns, so that each has faults
among the first. Exit code: 0 if every fault that was tried is noticed or harmless, 1 if one
survives, 2 if the list is wrong or the tests fail without a fault.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import multiprocessing
import os
import queue
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LISTS = tuple(
    Path(__file__).with_name(name) for name in ("verified.toml", "setid.toml", "checker.toml")
)
STORE = ROOT / ".mutants" / "results.json"
COPIED = ("sparsepop_py", "setid", "checker", "tests", "benchmarks", "examples", "pyproject.toml")
LONGEST = 240.0  # seconds for the tests of one fault; a fault that makes them hang is noticed
PLAIN = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--assert=plain")
ARGUMENTS = (*PLAIN, "--hypothesis-profile=mutants")

# Processes are forked from one that has imported all but the package, which saves most of a run.
FRESH = multiprocessing.get_context("forkserver")
HEAVY = ("scipy.optimize", "scipy.sparse.linalg", "networkx", "clarabel", "highspy", "sympy")
FRESH.set_forkserver_preload([*HEAVY, "mpmath", "matplotlib.figure", "hypothesis", "pytest"])
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}


@cache
def source(file: str) -> str:
    """The text of a source file."""
    return (ROOT / file).read_text()


@dataclass(frozen=True)
class Fault:
    """One snippet of a source file and its replacement, with the tests that should notice it."""

    file: str
    says: str
    find: str
    put: str
    tests: tuple[str, ...]
    harmless: str = ""

    @property
    def name(self) -> str:
        """File without the package, line and what is wrong."""
        text = source(self.file)
        line = text[: text.index(self.find)].count("\n") + 1
        return f"{self.file.partition('/')[2]}:{line} {self.says}"

    def changed(self, text: str) -> str:
        """The source with the fault."""
        return text.replace(self.find, self.put)

    def wrong(self) -> str:
        """Why this entry of the list makes no sense, empty if it does."""
        text = source(self.file)
        if text.count(self.find) != 1:
            return f"{self.find!r} occurs {text.count(self.find)} times, expected once"
        missing = [test for test in self.tests if not (ROOT / test).is_file()]
        if missing or not self.tests:
            return f"no tests {missing}"
        try:
            compile(self.changed(text), self.file, "exec")
        except SyntaxError as error:
            return f"no Python: {error}"
        return "nothing is changed" if self.find == self.put else ""


def read_list(path: Path) -> list[Fault]:
    """The faults of one list."""
    faults = []
    for source in tomllib.loads(path.read_text())["source"]:
        for entry in source["fault"]:
            tests = (*entry.pop("tests", ()), *source["tests"])
            faults.append(Fault(source["file"], tests=tests, **entry))
    return faults


def of_files(paths: Iterable[Path]) -> bytes:
    """A hash of files and their names."""
    total = hashlib.sha256()
    for path in sorted(set(paths)):
        total.update(f"{path.relative_to(ROOT)} ".encode() + path.read_bytes())
    return total.digest()


def digests(faults: list[Fault]) -> tuple[str, list[str]]:
    """Names of results, of the tests without a fault and of each fault.

    They change with the fault, its file, the tests and their helpers.
    """
    helpers = of_files((ROOT / "tests").rglob("helpers/*.py"))

    def name(files: Iterable[str], about: str) -> str:
        found = of_files(ROOT / file for file in files)
        return hashlib.sha256(helpers + found + about.encode()).hexdigest()

    whole = name([file for fault in faults for file in (fault.file, *fault.tests)], "")
    return whole, [name((f.file, *f.tests), repr((f.find, f.put, f.tests))) for f in faults]


class Workshop:
    """A copy of the work tree in which one fault after the other is tried."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: BaseProcess | None = None
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, folder / name)
            else:
                shutil.copy2(ROOT / name, folder / name)

    def attempt(self, fault: Fault) -> tuple[str, str]:
        """What became of a fault: "killed" with the test that noticed it, or "survived"."""
        path = self.folder / fault.file
        text = path.read_text()
        for stale in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            stale.unlink()
        path.write_text(fault.changed(text))
        try:
            for tests in (fault.tests[:1], fault.tests[1:]):
                if tests:
                    code, output = self.run(tests)
                    if code:
                        return "killed", _first_failure(code, output)
            return "survived", ""
        finally:
            path.write_text(text)

    def run(self, tests: tuple[str, ...], longest: float = LONGEST) -> tuple[int, str]:
        """Exit code and output of pytest on these files, -1 if it did not end in time."""
        output = self.folder / "output.txt"
        process = FRESH.Process(target=run_pytest, args=(self.folder, output, tests))
        process.start()
        self.process = process
        process.join(longest)
        if process.exitcode is None:
            self.stop()
            return -1, ""
        return process.exitcode, output.read_text()

    def stop(self) -> None:
        """End what runs, with the processes that tests have started."""
        if self.process is not None and self.process.is_alive():
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.join()


def run_pytest(folder: Path, output: Path, tests: tuple[str, ...]) -> None:
    """Run pytest on the copy in ``folder``, in a process that has not imported the package."""
    os.setsid()  # a test may start processes of its own: they end together
    os.chdir(folder)
    sys.path[:0] = [str(folder)]
    os.environ["PYTHONPATH"] = str(folder)
    with output.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    code = pytest.main([*ARGUMENTS, *tests])
    sys.stdout.flush()
    os._exit(code)


def _first_failure(code: int, output: str) -> str:
    """The test that noticed a fault, or how else the run ended."""
    if code < 0:
        return "no end"
    for line in output.splitlines():
        if line.startswith(("FAILED ", "ERROR ")):
            return line.split(" - ")[0].split(" ", 1)[1]
    return f"exit code {code}"


def read_store() -> dict[str, list]:
    """Results of earlier runs: outcome, test and seconds by digest."""
    return json.loads(STORE.read_text()) if STORE.exists() else {}


def write_store(known: dict[str, list]) -> None:
    """Replace the stored results, in one step."""
    STORE.parent.mkdir(exist_ok=True)
    part = STORE.with_suffix(".part")
    part.write_text(json.dumps(known, indent=1))
    part.replace(STORE)


def healthy(shop: Workshop, faults: list[Fault]) -> bool:
    """Whether all tests of the list pass without a fault."""
    tests = tuple(dict.fromkeys(test for fault in faults for test in fault.tests))
    code, output = shop.run(tests, LONGEST * 5)
    if code:
        print(output[-4000:], "\nthe tests fail without a fault")
    return code == 0


def in_turn(faults: list[tuple[Fault, str]]) -> list[tuple[Fault, str]]:
    """The first fault of each file, then the second of each, and so on."""
    seen: Counter[str] = Counter()
    turns = []
    for fault, name in faults:
        turns.append((seen[fault.file], len(turns), (fault, name)))
        seen[fault.file] += 1
    return [entry for _, _, entry in sorted(turns, key=lambda turn: turn[:2])]


def try_all(
    faults: list[Fault], whole: str, names: list[str], workers: int, end: float
) -> dict | None:
    """Try the faults whose results are not known; None if the tests fail without any."""
    known = read_store()
    left = in_turn([(f, name) for f, name in zip(faults, names, strict=True) if name not in known])
    if not left:
        return known
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        shops = [Workshop(Path(folder) / str(number)) for number in range(workers)]
        try:
            if whole not in known:
                if not healthy(shops[0], faults):
                    return None
                known[whole] = ["healthy", "", 0.0]
            try_each(left, known, shops, end)
        finally:
            for shop in shops:
                shop.stop()
    return known


def try_each(left: list[tuple[Fault, str]], known: dict, shops: list[Workshop], end: float) -> None:
    """Try faults in all workshops at once until the clock shows ``end``, and store each result."""
    free: queue.Queue[Workshop] = queue.Queue()
    for shop in shops:
        free.put(shop)

    def attempt(fault: Fault) -> list:
        shop, start = free.get(), time.monotonic()
        try:
            if start > end:
                return []
            return [*shop.attempt(fault), round(time.monotonic() - start, 1)]
        finally:
            free.put(shop)

    pool = ThreadPoolExecutor(len(shops))
    running = {pool.submit(attempt, fault): (fault, name) for fault, name in left}
    try:
        for number, done in enumerate(as_completed(running), start=1):
            fault, name = running[done]
            if not done.result():
                continue
            known[name] = done.result()
            write_store(known)
            print(f"{number}/{len(left)} {known[name][0]:9} {fault.name}", flush=True)
    finally:  # an interrupt waits for nothing
        pool.shutdown(wait=False, cancel_futures=True)


def report(faults: list[Fault], results: list[list]) -> int:
    """Print the table; the number of faults that survive without a reason."""
    rows, survivors = Counter(), 0
    print(f"\n{'':9}  fault, and the test that noticed it or why it is harmless")
    for fault, (outcome, test, _) in zip(faults, results, strict=True):
        if outcome == "survived":
            outcome = "harmless" if fault.harmless else "SURVIVED"
            survivors += not fault.harmless
        why = test or " ".join(fault.harmless.split())
        remark = " (the list says harmless)" if test and fault.harmless else ""
        print(f"{outcome:9}  {fault.name}{remark}\n{'':11}{why}")
        rows[outcome] += 1
    seconds = sum(result[2] for result in results)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in rows.items())
    print(f"\n{len(faults)} faults: {counts}; {seconds:.0f} seconds of one worker")
    return survivors


def main() -> int:
    """Run the faults of some lists."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("lists", nargs="*", type=Path, default=LISTS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin none later")
    parser.add_argument("--only", default="", help="faults whose name contains this")
    parser.add_argument("--again", action="store_true", help="forget what earlier runs found")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(2))
    os.environ.update(ENVIRONMENT)  # bytecode of a copy must not outlive its fault
    faults = [fault for path in given.lists for fault in read_list(path)]
    wrong = [f"{f.file}: {f.says}: {f.wrong()}" for f in faults if f.wrong()]
    if wrong:
        print("\n".join(wrong))
        return 2
    faults = [fault for fault in faults if given.only in fault.name]
    whole, names = digests(faults)
    if given.again:
        write_store({name: r for name, r in read_store().items() if name not in names})
    end = time.monotonic() + 60 * given.minutes
    known = try_all(faults, whole, names, given.workers, end)
    if known is None:
        return 2
    tried = [(f, known[name]) for f, name in zip(faults, names, strict=True) if name in known]
    survivors = report([fault for fault, _ in tried], [result for _, result in tried])
    if len(tried) < len(faults):
        print(f"{len(faults) - len(tried)} faults are not tried yet: run again to go on")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
