"""Measure what a task of a study costs beyond its solve, and lose a Dask worker in the middle.

Run it as ``python -m benchmarks.studies [TASKS]``; parts whose software is missing say so.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import sparsepop_py as sp
from sparsepop_py.executors.processes import Processes


def squares(path: Path, count: int) -> sp.Study:
    """Add problems whose minimum -c^2 is known: x^2 - 2 c x on [0, 20]."""
    (x,) = sp.variables(1)
    study = sp.Study(path)
    tasks = []
    for number in range(count):
        centre = 20 * (number + 1) / (count + 1)
        problem = sp.Problem(x**2 - 2 * centre * x, lower=0, upper=20)
        tasks.append((f"task {number}", problem, None, {"centre": centre}))
    study.add_all(tasks)
    return study


def timed(study: sp.Study, **how: Any) -> tuple[float, float]:
    """Run a study; return its wall time and the sum of the times of its tasks."""
    begin = time.perf_counter()
    status = study.run(**how)
    wall = time.perf_counter() - begin
    assert status.done == status.total, status
    return wall, sum(row["seconds"] for row in study.table(timings=True))


def wrong(study: sp.Study) -> int:
    """Count bounds on the wrong side of the known minimum."""
    return sum(
        not row["lower_bound"] <= -(row["centre"] ** 2) + 1e-12 <= row["upper_bound"] + 1e-9
        for row in study.table()
    )


def with_dask(act: Callable[[Executor, Any], None]) -> bool:
    """Call a function with a Dask executor of two workers and its cluster."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print("dask: distributed is missing")
        return False
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        client.get_executor() as pool,
    ):
        act(pool, cluster)
    return True


def main(count: int) -> None:
    """Print a table of wall time, time in tasks, and the difference a task."""
    folder = Path(tempfile.mkdtemp())
    here = squares(folder / "here.study", count)

    def show(name: str, wall: float, inside: float, workers: int) -> None:
        beyond = 1e3 * (wall * workers - inside) / count
        print(
            f"{name:24} {wall:8.2f} s wall {inside:8.2f} s in tasks {beyond:8.2f} ms a task beyond"
        )

    show("this process", *timed(here), 1)
    with Processes(2) as pool:
        list(pool.map(abs, range(8)))
        study = squares(folder / "two.study", count)
        show("two processes", *timed(study, executor=pool), 2)
        assert study.table() == here.table()

    def lose_one(pool: Executor, cluster: Any) -> None:
        study, lost = squares(folder / "dask.study", count), []

        def lose(status: sp.StudyStatus) -> None:
            if not lost and status.done >= status.total // 2:
                lost.append(next(iter(cluster.workers.values())).process.pid)
                os.kill(lost[0], signal.SIGKILL)

        show("Dask, a worker killed", *timed(study, executor=pool, on_progress=lose), 2)
        print(
            f"lost {len(lost)}; same table: {study.table() == here.table()}; wrong: {wrong(study)}"
        )

    with_dask(lose_one)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
