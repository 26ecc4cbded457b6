"""Limit a solve by wall time, CPU time, or counted work.

A stage that ends by itself asks :attr:`Deadline.over`. Long loops deep below, which are given no
deadline, call :func:`check`: it raises :class:`LimitReached` when the limits that
:meth:`Deadline.kept` keeps in this thread have passed by a grace. That grace is for the proof of
what a solver found when its time ended. Whoever keeps a deadline also catches the exception.

Clocks differ from run to run, and the adaptive search learns from them. Under a work limit every
decision rests on work instead: solvers, linear programs, local searches and nodes each report
iterations times a cost that depends on sizes only. Runs are then reproducible, and a run with a
larger limit begins like one with a smaller limit. Solvers are given the iterations that the work
left allows (:func:`iterations_left`). What needs far more work than is left is not begun, and
nothing else in its place (:func:`outlasts`, :meth:`Deadline.give_up`).

One unit of work is about one second of one core of 2020. The model is a convention: it is fixed
by the constants in this module and in the modules that call :func:`spend`.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

__all__ = [
    "EARLY",
    "TOO_LARGE",
    "TOO_LONG",
    "TOO_MUCH",
    "Deadline",
    "LimitReached",
    "before_check",
    "charge",
    "check",
    "counting_from",
    "cpu_seconds",
    "importing",
    "iterations_left",
    "meter",
    "outlasts",
    "pace",
    "spend",
    "spent",
]

TOO_LARGE = "needs more than"  # in notes about relaxations that no memory is allowed for
TOO_LONG = "too long for the time left"  # in notes about what was not begun
TOO_MUCH = "far more than the work left"  # the same under a limit on work
_GRACE = 0.2  # of a limit: proofs under way when it passes may take so much longer
_MOST_PACE = 100.0  # wall seconds to a CPU second on the busiest machine that is thought of
_UNIT = 2.0**36  # parts of a unit of work: sums of them are exact in any order
_OVERWORK = 2.0  # times the work left that a step may be expected to need,
_LEAST_WORK = 0.2  # and units of work beyond that: small steps are done in any case
_imports = 0.0  # CPU seconds of this process in which modules were loaded


class _Meter:
    """Work done in a thread, or in a task that goes on from another thread's."""

    def __init__(self, before: _Meter | None = None) -> None:
        self.before = before
        self.total: float = 0.0 if before is None else before.total

    def goes_on_from(self, other: _Meter | None) -> bool:
        """Check whether this meter is another one or began at what that showed."""
        return self is other or (self.before is not None and self.before.goes_on_from(other))


class _Own(threading.local):
    """The meter of this thread."""

    def __init__(self) -> None:
        self.meter = _Meter()


_OWN = _Own()


def spend(work: float) -> None:
    """Count work that was done in this thread.

    Parameters
    ----------
    work : float
        In units of about one second.
    """
    _OWN.meter.total += _counted(work)


def spent() -> float:
    """Return the work that was counted in this thread so far."""
    return _OWN.meter.total


def _counted(work: float) -> float:
    """Round work to parts whose sums are exact, whatever was counted before."""
    return work if abs(work) == np.inf else round(work * _UNIT) / _UNIT


def meter() -> _Meter:
    """Return what counts the work of this thread, for tasks that go on from it."""
    return _OWN.meter


@contextmanager
def counting_from(other: _Meter) -> Iterator[None]:
    """Count on from another thread's work within a with statement; then forget it.

    A deadline that a task shares with that thread has then as much work left as there.

    Parameters
    ----------
    other : _Meter
        What :func:`meter` returned there.
    """
    before, _OWN.meter = _OWN.meter, _Meter(other)
    try:
        yield
    finally:
        _OWN.meter = before


class LimitReached(Exception):
    """Interrupt a computation when time is over; callers keep what is proved."""


EARLY = (KeyboardInterrupt, LimitReached)  # what ends a search early, with its results kept


class _Kept(threading.local):
    """Ends kept in this thread: wall clock and CPU clock for :func:`check`, and work."""

    wall = np.inf
    cpu = np.inf
    work = np.inf
    charged = 0.0
    deadline: Deadline | None = None


_KEPT = _Kept()


def _forget() -> None:
    """Leave the limits of the process that forked this one; tasks bring their own."""
    _KEPT.__dict__.clear()


if hasattr(os, "register_at_fork"):  # an executor starts workers where the first task is submitted
    os.register_at_fork(after_in_child=_forget)


def check() -> None:
    """Raise ``LimitReached`` if the limits kept in this thread have passed.

    Without :meth:`Deadline.kept` nothing happens. It costs less than a microsecond.

    Raises
    ------
    LimitReached

    Examples
    --------
    >>> from sparsepop_py.budget import Deadline, check
    >>> with Deadline(1e-9).kept():
    ...     check()
    Traceback (most recent call last):
    ...
    sparsepop_py.budget.LimitReached
    """
    if time.monotonic() >= _KEPT.wall or (_KEPT.cpu < np.inf and time.process_time() >= _KEPT.cpu):
        raise LimitReached


def before_check() -> float:
    """Return seconds of wall time before :func:`check` raises, inf without kept limits."""
    return _KEPT.wall - time.monotonic()


def iterations_left(work: float, least: int = 1) -> float:
    """Return how many iterations the kept limit on work allows, inf without such a limit.

    Where a solver does all of them, the limit has passed.

    Parameters
    ----------
    work : float
        Of one iteration.
    least : int
        Iterations that are allowed in any case.
    """
    if _KEPT.work == np.inf:
        return np.inf
    return max(float(least), np.ceil((_KEPT.work - spent()) / work))


def outlasts(work: float) -> bool:
    """Check for a step that needs far more work than is left.

    Where it does, the kept deadline is given up.

    Parameters
    ----------
    work : float
        That the step is expected to need at least.

    Examples
    --------
    >>> from sparsepop_py.budget import Deadline, outlasts
    >>> with Deadline(None, work_limit=1.0).kept():
    ...     outlasts(1.5), outlasts(100.0)  # twice the work left is begun
    (False, True)
    """
    if work <= _LEAST_WORK + _OVERWORK * max(0.0, _KEPT.work - spent()):
        return False
    if _KEPT.deadline is not None:
        _KEPT.deadline.give_up()
    return True


def pace() -> float:
    """Return wall seconds to a CPU second, as this thread's deadline saw."""
    return 1.0 if _KEPT.deadline is None else _KEPT.deadline.pace


def cpu_seconds() -> float:
    """Return CPU seconds of this process, and of others that :func:`charge` counted."""
    return time.process_time() + _KEPT.charged


@contextmanager
def importing() -> Iterator[None]:
    """Leave what happens once in a process, such as imports, out of compared costs.

    The adaptive search would take a first solve for slow, and what follows it too.

    Examples
    --------
    >>> from sparsepop_py.budget import Deadline, importing
    >>> deadline = Deadline(None)
    >>> before = deadline.now()
    >>> with importing():
    ...     total = sum(range(10**6))
    >>> deadline.now() - before < 0.001
    True
    """
    global _imports
    before = time.process_time(), _imports
    try:
        yield
    finally:  # what is imported may import in turn, and other threads meanwhile
        _imports = max(_imports, before[1] + time.process_time() - before[0])


def charge(seconds: float) -> None:
    """Count CPU seconds that another process spent for the work of this thread."""
    _KEPT.cpu -= seconds
    _KEPT.charged += seconds
    if _KEPT.deadline is not None:
        _KEPT.deadline.charge(seconds)


class Deadline:
    """Deadline of a solve: after some wall time, CPU time or work. Mutable.

    Pickled, it goes on in another process with what is left: CPU time and work are those of each
    process by itself.

    Parameters
    ----------
    limit : float or None
        Seconds of wall time from now; None for no limit.
    work_limit : float or None
        Units of work from now. With it nothing is decided by a clock, unless ``limit`` or
        ``cpu_limit`` is given too.
    cpu_limit : float or None
        Seconds of CPU time of this process from now.

    Examples
    --------
    >>> from sparsepop_py.budget import Deadline, spend
    >>> deadline = Deadline(None, work_limit=1.0)
    >>> deadline.over, deadline.left
    (False, None)
    >>> spend(2.0)
    >>> deadline.over
    True
    """

    def __init__(
        self,
        limit: float | None = None,
        work_limit: float | None = None,
        cpu_limit: float | None = None,
    ) -> None:
        self._begin, self._begin_cpu = time.monotonic(), time.process_time()
        self._limit, self._cpu_limit = limit, cpu_limit
        self._meter = _OWN.meter  # of the thread that asks; tasks in others have their own
        self._last = None if work_limit is None else spent() + _counted(work_limit)
        self._stopped = False
        self._whole: Deadline | None = None  # of which this is a part
        self.cut = False  # something was not begun since it would have taken too long

    @classmethod
    def before(cls, moment: float, most: float, share: float = 1.0) -> Deadline:
        """Return a deadline after seconds, or after work where no moment is given.

        Every stage that ends after a time of its own is given one of these: where no limit in time
        was asked for, no clock then changes what it finds.

        Parameters
        ----------
        moment : float
            On the monotonic clock; infinite where nothing ends the work.
        most : float
            Seconds, or units of work where the moment is infinite.
        share : float
            Of the seconds until the moment, which may be taken at most.

        Examples
        --------
        >>> from sparsepop_py.budget import Deadline
        >>> stage = Deadline.before(float("inf"), 5.0)
        >>> stage.counts_work, stage.left
        (True, None)
        """
        if moment == np.inf:
            return cls(None, most)
        return cls(min(most, share * (moment - time.monotonic())))

    def charge(self, seconds: float) -> None:
        """Count CPU seconds that another process spent on this work, for its whole too."""
        self._begin_cpu -= seconds
        if self._whole is not None:
            self._whole.charge(seconds)

    def stop(self) -> None:
        """End now, and all that this is a part of: the user interrupted."""
        self._stopped = True
        if self._whole is not None:
            self._whole.stop()

    def give_up(self) -> None:
        """End the limit on work now, not that of the whole.

        What comes next needs far more.

        Something smaller in its place might prove more than a run does whose larger limit is used
        up by what is not begun here.
        """
        self.cut = True
        if self._last is not None:
            self._last -= max(0.0, self._work_left)

    def ended(self, cause: BaseException) -> None:
        """Note what ended the work early: an interrupt by the user ends all of it."""
        if isinstance(cause, KeyboardInterrupt):
            self.stop()

    @property
    def stopped(self) -> bool:
        """True if the user interrupted this work or the whole of it."""
        return self._stopped or (self._whole is not None and self._whole.stopped)

    @property
    def counts_work(self) -> bool:
        """True if decisions rest on work and not on clocks."""
        return self._last is not None

    def now(self) -> float:
        """Return CPU seconds without imports, or units of work under a work limit.

        Only differences matter.
        """
        return spent() if self.counts_work else time.process_time() - _imports

    @property
    def left(self) -> float | None:
        """Seconds of wall time left, at least a millisecond; None without a limit in time.

        Of a limit of CPU time, the wall time that it is expected to last on this machine now.
        """
        end = self.end
        return None if end == np.inf else max(1e-3, end - time.monotonic())

    @property
    def end(self) -> float:
        """Moment on the monotonic clock when time is over, inf without a limit."""
        if self.stopped:
            return time.monotonic()
        wall, cpu = self._ends(0.0)
        if cpu == np.inf:
            return wall
        return min(wall, time.monotonic() + self.pace * (cpu - time.process_time()))

    @property
    def pace(self) -> float:
        """Wall seconds to a CPU second of the whole so far, at least 1."""
        if self._whole is not None:  # which has seen more of the machine
            return self._whole.pace
        used = max(1e-2, time.process_time() - self._begin_cpu)
        return float(np.clip((time.monotonic() - self._begin) / used, 1.0, _MOST_PACE))

    @property
    def expected(self) -> float | None:
        """CPU seconds that are expected to be left; None without a limit in time."""
        left = self.left
        return None if left is None else left / self.pace

    @property
    def late(self) -> bool:
        """True if a limit in time has passed, whatever work was done."""
        return self.stopped or time.monotonic() >= self.end

    def part(self, share: float, otherwise: float | None = None) -> Deadline:
        """Return a deadline after a share of the time and work left.

        An interrupt ends the whole and all its parts.

        Parameters
        ----------
        share : float
        otherwise : float, optional
            Units of work where there is no limit, so that runs repeat.
        """
        wall, _ = self._ends(0.0)
        left = None if wall == np.inf else share * max(0.0, wall - time.monotonic())
        cpu_left = None if self.cpu_left is None else share * self.cpu_left
        work = None if self._last is None else share * max(0.0, self._work_left)
        unlimited = left is cpu_left is work is None
        found = Deadline(left, otherwise if unlimited else work, cpu_left)
        found._whole = self
        return found

    @property
    def wall_end(self) -> float:
        """Moment on the monotonic clock when wall time is over, inf without such a limit."""
        return time.monotonic() if self.stopped else self._ends(0.0)[0]

    @property
    def cpu_left(self) -> float | None:
        """Seconds of CPU time left, at least a millisecond; None without such a limit."""
        cpu = self._ends(0.0)[1]
        return None if cpu == np.inf else max(1e-3, cpu - time.process_time())

    @property
    def limits(self) -> dict[str, Any]:
        """Return what is left of each limit, as options of a solve."""
        left = {"cpu_limit": self.cpu_left}
        if self.wall_end < np.inf:
            left["time_limit"] = max(1e-3, self.wall_end - time.monotonic())
        if self._last is not None:
            left["work_limit"] = max(1e-3, self._work_left)
        return {name: limit for name, limit in left.items() if limit is not None}

    @property
    def unlimited(self) -> bool:
        """True if no limit will ever end the work."""
        work = self._last is None or self._last == np.inf
        return work and not self.stopped and self._ends(0.0) == (np.inf, np.inf)

    @property
    def over(self) -> bool:
        """True if a limit has passed."""
        return self.late or self._work_left <= 0.0

    @property
    def _work_left(self) -> float:
        """Units of work left, inf without limit; other threads' work is none of its own."""
        if self._last is None:
            return np.inf
        own = _OWN.meter
        return self._last - (own if own.goes_on_from(self._meter) else self._meter).total

    def _ends(self, grace: float) -> tuple[float, float]:
        """Compute the ends on both clocks, with a share of grace."""
        wall = np.inf if self._limit is None else self._begin + (1.0 + grace) * self._limit
        if self._cpu_limit is None:
            return wall, np.inf
        return wall, self._begin_cpu + (1.0 + grace) * self._cpu_limit

    @contextmanager
    def kept(self, grace: float = _GRACE) -> Iterator[None]:
        """Hold the limits within the body of a with statement, by :func:`check` and solvers.

        Parameters
        ----------
        grace : float
            Share of the limits that proofs under way may take longer.
        """
        before = _KEPT.wall, _KEPT.cpu, _KEPT.work, _KEPT.deadline
        wall, cpu = self._ends(grace)
        work = spent() + self._work_left  # the meter may be that of another thread
        _KEPT.wall, _KEPT.cpu = min(before[0], wall), min(before[1], cpu)
        _KEPT.work, _KEPT.deadline = min(before[2], work), self
        try:
            yield
        finally:
            _KEPT.wall, _KEPT.cpu, _KEPT.work, _KEPT.deadline = before

    def __getstate__(self) -> dict[str, Any]:
        """Store what is left of each limit, and what has passed."""
        now, now_cpu = time.monotonic(), time.process_time()
        state = dict(
            self.__dict__,
            _whole=None,
            _meter=None,
            _begin=self._begin - now,
            _begin_cpu=self._begin_cpu - now_cpu,
        )
        state["_stopped"] = self.stopped
        return state | {"_last": None if self._last is None else self._work_left}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Go on from now with what was left."""
        self.__dict__.update(state)
        self._meter = _OWN.meter
        self._begin += time.monotonic()
        self._begin_cpu += time.process_time()
        if self._last is not None:
            self._last += spent()
