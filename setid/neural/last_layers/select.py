"""The structure loop for networks: lags and widths, judged by proved bands on another record."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from setid import DataError, IOData, ModelError, NoiseError, SetidError
from setid.data.checks import entries_of, seconds_of
from setid.neural.last_layers.last_layer import LastLayer, last_layer
from setid.neural.models.regressor import NNARX
from setid.neural.training.train import initial, train
from setid.options import check_executor
from sparsepop_py.executors.dispatch import map_in_order

__all__ = ["Candidate", "NetworkSelection", "select"]

_LONGEST = 60.0  # seconds for one last layer, and for its band


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One structure and why it was kept or not.

    Parameters
    ----------
    order, width : int
    result : LastLayer
        On the record that it was trained on.
    least_error : float
        Attained by the last layer; infinite where no member is proved.
    band_width : float
        Mean width of the proved one-step band of readings on the validation record.
    outside : int
        Readings outside that band: one of them falsifies the assumptions.
    decision : str
    """

    order: int
    width: int
    result: LastLayer
    least_error: float
    band_width: float
    outside: int
    decision: str

    def __repr__(self) -> str:
        return (
            f"order {self.order}, {self.width} neurons: least error {self.least_error:.4g}, band "
            f"{self.band_width:.4g} wide, {self.outside} outside: {self.decision}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class NetworkSelection:
    """Result of the loop over structures: all candidates and the one chosen.

    Parameters
    ----------
    chosen : Candidate
    log : tuple of Candidate
        All structures, in the order in which they were tried; after Ctrl-C or the time limit
        those that are done.
    """

    chosen: Candidate
    log: tuple[Candidate, ...]


def select(
    data: IOData,
    validation: IOData,
    orders: Sequence[int] = (1, 2, 3),
    widths: Sequence[int] = (2, 4, 8),
    factor: float = 1.5,
    activation: str = "tanh",
    starts: int = 3,
    seed: int = 0,
    executor: Executor | None = None,
    time_limit: float = 600.0,
) -> NetworkSelection:
    """Choose order and width by the narrowest proved band that no reading falsifies.

    Parameters
    ----------
    data, validation : IOData
        Hidden layers are trained and last layers bounded on the first, bands judged on the other.
    orders, widths : sequence of int
    factor : float
        The bound of the equation error is this multiple of the least that explains ``data``,
        which makes it an assumption.
    activation : str
    starts, seed : int
        Of the training.
    executor : concurrent.futures.Executor, optional
        Trains and judges each structure as a task of its own; the selection is the same.
    time_limit : float
        Seconds for all structures together: none is begun when they are over, and linear programs
        end then. Training under way may take longer.

    Returns
    -------
    NetworkSelection
        Where every structure is falsified, the one with the fewest readings outside. Ctrl-C ends
        the loop without an executor: the choice is among those that are done, if there are any.

    Raises
    ------
    ModelError, DataError, SetidError
        If there is nothing to choose from, records do not fit, or no structure is done within the
        limit.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import neural
    >>> u = np.sin(np.arange(80.0) ** 1.3)
    >>> data = setid.IOData(u, np.append(0.0, np.tanh(u[:-1])) + 1e-3 * np.cos(7.0 * u))
    >>> found = neural.select(*data.split(50), orders=[1], widths=[1, 2], starts=1)
    >>> len(found.log), found.chosen.order
    (2, 1)
    """
    check_executor(executor)
    for name, record in (("data", data), ("validation", validation)):
        if not isinstance(record, IOData):
            raise DataError(f"{name}: found {type(record).__name__}, expected IOData")
    until = time.time() + seconds_of(time_limit)  # the clock of all processes
    settings = (data, validation, factor, activation, starts, seed, until)
    known = entries_of(orders, "orders", "a list of integers", ModelError)
    sizes = entries_of(widths, "widths", "a list of integers", ModelError)
    tasks = [(order, width, settings) for order in known for width in sizes]
    if not tasks:
        raise ModelError("orders, widths: found no structure, expected at least one")
    log = _tried_all(executor, tasks)
    if not log:
        raise SetidError(
            f"time_limit: found no structure that is done within {time_limit!r} s, expected more"
        )
    chosen = min(log, key=lambda item: (item.outside, item.band_width))
    return NetworkSelection(chosen, tuple(log))


def _tried_all(executor: Executor | None, tasks: list[tuple[Any, ...]]) -> list[Candidate]:
    """Try structures in turn; Ctrl-C keeps those that are done."""
    if executor is not None:
        return [item for item in map_in_order(executor, _tried, tasks) if item is not None]
    log: list[Candidate] = []
    try:
        for task in tasks:
            done = _tried(task)
            if done is None:
                break
            log.append(done)
    except KeyboardInterrupt:
        if not log:
            raise
    return log


def _tried(task: tuple[int, int, tuple[Any, ...]]) -> Candidate | None:
    """Train and judge one structure, in a worker if there is an executor; None without time."""
    order, width, (data, validation, factor, activation, starts, seed, until) = task
    if time.time() >= until:
        return None
    guess = initial(data, order, [width], activation, seed)
    assert isinstance(guess, NNARX)
    trained = train(guess, data, starts=starts)
    assert isinstance(trained.net, NNARX)
    if time.time() >= until:
        return None
    try:
        result = last_layer(trained.net, data, factor=factor, time_limit=_left(until))
    except NoiseError:  # the least noise bound is not known in time
        if time.time() < until:
            raise
        return None
    return _judge(result, validation, order, width, _left(until))


def _left(until: float) -> float:
    return min(max(until - time.time(), 0.0), _LONGEST)


def _judge(
    result: LastLayer, validation: IOData, order: int, width: int, seconds: float
) -> Candidate:
    band = result.band(validation, seconds)
    outside = len(band.outside)
    text = "falsified by the validation record" if outside else "consistent"
    text = text if np.isfinite(band.width) else "no finite band was proved"
    bounds = result.noise.bounds(result.data)[2]
    least = float(result.upper_bound.max()) * float(max(bounds.max(), 0.0))
    return Candidate(order, width, result, least, band.width, outside, text)
