"""Processes of our own and tasks that outlive lost workers."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor, wait
from multiprocessing import get_context
from threading import Lock, Thread

import pytest

from sparsepop_py.errors import ProblemError, SparsePOPError
from sparsepop_py.executors.dispatch import completed, map_in_order, opened, workers_of
from sparsepop_py.executors.processes import Processes, WorkerLost

POSIX = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def test_results_and_exceptions_come_back() -> None:
    with Processes(1) as pool:
        assert pool.submit(math.gcd, 12, 18).result() == 6
        assert pool.submit(int, "11", base=2).result() == 3
        with pytest.raises(ValueError, match="math|nonnegative") as caught:
            pool.submit(math.sqrt, -1.0).result()
        assert "worker.py" in caught.value.__notes__[0]
        assert pool.submit(print, "text on its standard output").result() is None
        assert pool.submit(math.sqrt, 4.0).result() == 2.0
    with pytest.raises(RuntimeError, match="after shutdown"):
        pool.submit(math.sqrt, 4.0)


@POSIX
def test_a_lost_process_costs_its_task_alone() -> None:
    with Processes(1) as pool:
        first = pool.submit(os.getpid).result()
        asleep, after = pool.submit(time.sleep, 60), pool.submit(os.getpid)
        time.sleep(0.2)
        os.kill(first, signal.SIGKILL)
        with pytest.raises(WorkerLost):
            asleep.result()
        assert after.result() != first


@POSIX
def test_a_process_that_is_lost_while_it_waits_is_replaced() -> None:
    with Processes(1) as pool:
        first = pool.submit(os.getpid).result()
        os.kill(first, signal.SIGKILL)
        time.sleep(0.2)
        assert pool.submit(os.getpid).result() != first


def test_stop_ends_what_runs_and_what_waits() -> None:
    pool = Processes(1)
    pool.submit(os.getpid).result()
    running, waiting = pool.submit(time.sleep, 60), pool.submit(time.sleep, 60)
    time.sleep(0.1)
    pool.stop()
    with pytest.raises(WorkerLost):
        running.result()
    with pytest.raises(CancelledError):
        waiting.result()


@POSIX
def test_processes_end_with_the_one_that_started_them() -> None:
    code = (
        "import os, time; from sparsepop_py.executors.processes import Processes; "
        "pool = Processes(1); print(pool.submit(os.getpid).result(), flush=True); "
        "pool.submit(time.sleep, 60); time.sleep(60)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment)
    assert child.stdout is not None
    worker = int(child.stdout.readline())
    os.kill(worker, 0)  # it is there
    child.kill()
    child.wait()
    child.stdout.close()
    for _ in range(400):
        if gone(worker):
            return
        time.sleep(0.05)
    raise AssertionError(f"process {worker} is still there")


def gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    try:  # ended, but nobody has asked for its exit code
        with open(f"/proc/{process}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


@pytest.mark.parametrize("workers", [0, -1, 1.5, True, "2"])
def test_wrong_numbers_of_workers_are_named(workers: object) -> None:
    with pytest.raises(ProblemError, match="workers: found"):
        Processes(workers)  # type: ignore[arg-type]


def test_exceptions_of_the_function_are_raised() -> None:
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(ValueError, match="math|nonnegative") as raised,
    ):
        map_in_order(pool, math.sqrt, [4.0, -1.0])
    assert raised.value.__notes__ == ["executor: a task on ThreadPoolExecutor raised this"]


def test_answers_that_cannot_be_read_leave_the_others_alone() -> None:
    """This exception pickles, and its pickle lacks arguments."""
    with Processes(1) as pool:
        lost = pool.submit(subprocess.TimeoutExpired, cmd="x", timeout=1)
        after = pool.submit(math.sqrt, 4.0)
        with pytest.raises(TypeError, match="timeout"):
            lost.result(30)
        assert after.result(30) == 2.0


def test_an_executor_that_was_shut_down_is_named() -> None:
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(SparsePOPError, match="takes no tasks any more"):
        list(completed(pool, math.sqrt, [("a", 4.0)]))


def test_tasks_are_taken_as_they_are_needed() -> None:
    """Arguments of a study of 10^5 tasks are not all in memory."""
    taken = []

    def tasks():
        for number in range(1000):
            taken.append(number)
            yield number, float(number)

    with ThreadPoolExecutor(1) as pool:
        found = completed(pool, math.sqrt, tasks())
        next(found)
        assert len(taken) < 200
        assert len(list(found)) == 999


def test_opened_makes_processes_for_more_than_one_worker() -> None:
    with opened(None, None) as none, opened(1, None) as one, opened(2, None) as two:
        assert none is None and one is None and isinstance(two, Processes)


def test_a_task_of_threads_does_not_wait_for_others_of_the_same_threads() -> None:
    """All threads would wait for tasks that none of them is left to do."""
    pool = ThreadPoolExecutor(1)
    try:
        tasks = pool.submit(map_in_order, pool, math.sqrt, [4.0, 9.0])
        assert tasks.result(5) == [2.0, 3.0]
        assert pool.submit(workers_of, pool).result(5) == 0 and workers_of(pool) == 1
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def test_a_shutdown_does_not_come_between_a_task_and_its_queue() -> None:
    class Closing:
        """Lock of a pool that another thread shuts down when a task has been taken."""

        def __init__(self) -> None:
            self.lock, self.closed = Lock(), False

        def __enter__(self) -> None:
            self.lock.acquire()

        def __exit__(self, *raised: object) -> None:
            self.lock.release()
            if not self.closed:
                self.closed = True
                pool.shutdown(wait=False)

    pool = Processes(1)
    pool._lock = Closing()  # type: ignore[assignment]
    assert pool.submit(math.sqrt, 4.0).result(30) == 2.0


def test_who_waits_for_tasks_hears_that_they_are_cancelled() -> None:
    pool = Processes(1)
    pool.submit(time.sleep, 60)
    waiting = Thread(target=wait, args=([pool.submit(math.sqrt, 4.0)],), daemon=True)
    waiting.start()
    time.sleep(0.1)
    pool.stop()
    waiting.join(10)
    assert not waiting.is_alive()


def test_tasks_that_cannot_be_pickled_are_named() -> None:
    with Processes(1) as pool:
        for function, argument in ((lambda x: x, 1.0), (math.sqrt, Lock())):
            with pytest.raises(ProblemError, match="executor: found a task that cannot be pickled"):
                map_in_order(pool, function, [argument])


def in_a_forked_process() -> float:
    root = INHERITED[0].submit(math.sqrt, 4.0).result(30)
    INHERITED[0].shutdown()
    return root


INHERITED: list[Processes] = []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_a_forked_process_has_processes_of_its_own() -> None:
    """Threads that serve those of the first process are not there."""
    with Processes(1) as pool, ProcessPoolExecutor(1, mp_context=get_context("fork")) as forked:
        first = pool.submit(os.getpid).result()
        INHERITED[:] = [pool]
        job = forked.submit(in_a_forked_process)
        processes = list(forked._processes.values())
        try:
            assert job.result(30) == 2.0
        finally:
            for process in processes:  # else a test that fails would wait for it
                process.kill()
        assert pool.submit(os.getpid).result() == first
