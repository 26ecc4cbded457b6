"""The structure loop: the simplest structure that the data do not refute, step by step.

From the smallest order and degree upwards, a structure is left only when the data prove it
wrong (its feasible set is empty). The first one with a consistent parameter vector is kept;
its intervals then say which coefficients are needed. A sign is trusted only where it is
settled: a gap as wide as the attained interval tells nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

import sparsepop_py as sp
from setid.data.checks import entries_of, natural
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.html import listing, section, table
from setid.identify import identify
from setid.models.equations import Structure
from setid.models.registry import family_of
from setid.options import Options
from setid.priors.base import Prior
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.result.identification import Identification
from sparsepop_py.executors.dispatch import completed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Selection", "SelectionStep", "select"]

Family = Callable[[int, int], Structure]
_LEAST = 1e-3  # seconds for a structure when the time is over


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SelectionStep:
    """One structure that was tried, and why it was left or kept.

    Parameters
    ----------
    order, degree : int
    decision : {"refuted", "kept", "open"}
    reason : str
    result : Identification

    Examples
    --------
    >>> import setid
    >>> u = [1, -1, 2, 0, 1, -2, 1, 3]
    >>> y = setid.simulate(setid.TransferFunction(1, 2), [-0.5, 0, 1], u)
    >>> data, noise = setid.IOData(u, y), setid.Noise(equation=1e-3)
    >>> setid.select(data, setid.TransferFunction, noise, [0, 1]).steps[0].decision
    'refuted'
    """

    order: int
    degree: int
    decision: str
    reason: str
    result: Identification

    def __repr__(self) -> str:
        return f"order {self.order}, degree {self.degree}: {self.decision}: {self.reason}"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Selection:
    """The log of a structure loop and what it ends with.

    Parameters
    ----------
    steps : tuple of SelectionStep
        In the order in which structures were tried.
    chosen : SelectionStep or None
        The first structure with consistent parameters; None where all are refuted or open.
    coefficients : mapping of str to str
        For each coefficient of the chosen structure whether it is ``"needed"`` (its interval
        excludes zero, proved), ``"idle"`` (zero lies between attained values) or ``"open"``,
        with the reason.

    Examples
    --------
    >>> import setid
    >>> u = [1, -1, 2, 0, 1, -2, 1, 3]
    >>> y = setid.simulate(setid.TransferFunction(1, 2), [-0.5, 0, 1], u)
    >>> data, noise = setid.IOData(u, y), setid.Noise(equation=1e-3)
    >>> setid.select(data, setid.TransferFunction, noise, [0, 1])
    <Selection: order 1, degree 1>
    """

    steps: tuple[SelectionStep, ...]
    chosen: SelectionStep | None
    coefficients: dict[str, str]

    @property
    def result(self) -> Identification | None:
        """The identification with the chosen structure."""
        return None if self.chosen is None else self.chosen.result

    @property
    def log(self) -> str:
        """Every decision with its reason, one a line."""
        lines = [repr(step) for step in self.steps]
        lines += [f"  {name}: {text}" for name, text in self.coefficients.items()]
        if self.chosen is None:
            lines.append("no structure with consistent parameters was found")
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the decisions; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_selection

        return plot_selection(self, ax)

    def _repr_html_(self) -> str:
        rows = [(s.order, s.degree, s.decision, s.reason) for s in self.steps]
        return section(
            repr(self)[1:-1],
            table(["order", "degree", "decision", "reason"], rows),
            listing("coefficients", (f"{n}: {text}" for n, text in self.coefficients.items())),
        )

    def __repr__(self) -> str:
        if self.chosen is None:
            return f"<Selection: none of {len(self.steps)}>"
        return f"<Selection: order {self.chosen.order}, degree {self.chosen.degree}>"


def select(
    data: IOData,
    family: str | type | Family,
    noise: Noise,
    orders: Iterable[int],
    degrees: Iterable[int] = (1,),
    priors: Iterable[Prior | sp.Constraint] = (),
    options: Options | None = None,
    *,
    executor: Executor | None = None,
) -> Selection:
    """Find the simplest structure that the data do not refute.

    Parameters
    ----------
    data : IOData
    family : type, str or callable
        ``TransferFunction``: order n means na = n, nb = n + 1 without delay.
        ``PolynomialNARX``: all monomials up to the degree in n past outputs and inputs.
        Or another registered structure or its name (:func:`setid.register_structure`).
        Otherwise ``family(order, degree)`` makes the structure.
    noise : Noise
    orders, degrees : iterable of int
        In the order to try; degrees are raised first.
    priors : iterable of priors and ``sp`` constraints
    options : Options, optional
        For each identification; ``time_limit`` is for all of them together.
    executor : concurrent.futures.Executor, optional
        Tries all structures at once, each as one task with an equal share of the time limit.
        Those behind the first that is kept are dropped, so the steps are the same.

    Returns
    -------
    Selection

    Raises
    ------
    SetidError
        If there is no order or degree to try, or the parts do not fit together.

    Examples
    --------
    >>> import setid
    >>> u = [1, -1, 2, 0, 1, -2, 1, 3]
    >>> model = setid.TransferFunction(na=1, nb=2)
    >>> y = setid.simulate(model, [-0.5, 0, 1], u)
    >>> data = setid.IOData(u, y)
    >>> found = setid.select(data, setid.TransferFunction, setid.Noise(equation=1e-3), [0, 1, 2])
    >>> found.chosen.order, found.steps[0].decision
    (1, 'refuted')
    """
    make = _family(family, data)
    sizes = _naturals(orders, "orders", 0)
    tops = _naturals(degrees, "degrees", 1)
    if not sizes or not tops:
        raise SetidError("orders, degrees: found none, expected at least one of each")
    known, settings = list(priors), options or Options()
    tried = list(product(sizes, tops))
    given = data, noise, known, settings
    found = (
        _in_turn(make, tried, given) if executor is None else _at_once(make, tried, given, executor)
    )
    steps = list[SelectionStep]()
    with closing(found):
        for step in found:
            steps.append(step)
            if step.decision == "kept":
                return Selection(tuple(steps), step, _coefficients(step.result))
    return Selection(tuple(steps), None, {})


_Given = tuple[IOData, Noise, list[Any], Options]
_Steps = Generator[SelectionStep, None, None]


def _in_turn(make: Family, tried: list[tuple[int, int]], given: _Given) -> _Steps:
    """Try one structure after the other; those soon refuted leave their time to the others."""
    data, noise, known, settings = given
    until = settings.deadline()
    for place, (order, degree) in enumerate(tried):
        if until < inf:
            share = max((until - time.monotonic()) / (len(tried) - place), _LEAST)
            settings = replace(settings, time_limit=share)
        result = identify(data, make(order, degree), noise, known, settings)
        yield SelectionStep(order, degree, *_decision(result), result)


def _at_once(
    make: Family, tried: list[tuple[int, int]], given: _Given, executor: Executor
) -> _Steps:
    """Try all structures at once; yield them in their order."""
    data, noise, known, settings = given
    if settings.time_limit is not None:
        settings = replace(settings, time_limit=max(settings.time_limit / len(tried), _LEAST))
    settings = replace(settings, progress=False)
    tasks = ((k, (data, make(*tried[k]), noise, known, settings)) for k in range(len(tried)))
    ready: dict[int, Identification] = {}
    place = 0
    with closing(completed(executor, _identify_task, tasks)) as found:
        for done in found:
            if done.value is None:
                raise SetidError(f"executor: structure {tried[done.key]} was given up: {done.lost}")
            ready[done.key] = done.value
            while place in ready:
                result = ready.pop(place)
                yield SelectionStep(*tried[place], *_decision(result), result)
                place += 1


def _identify_task(task: tuple[Any, ...]) -> Identification:
    """Identify in a worker process."""
    return identify(*task)


def _naturals(given: Any, field: str, least: int) -> list[int]:
    listed = entries_of(given, field, "a list of integers", SetidError)
    return [natural(item, field, SetidError, least) for item in listed]


def _family(family: Any, data: IOData) -> Family:
    """Structures by order and degree, of a registered structure or as the caller makes them."""
    known = family_of(family) if isinstance(family, (str, type)) else None
    if known is not None:
        return lambda order, degree: known(order, degree, data.inputs, data.outputs)
    if not callable(family):
        raise ModelError(
            f"family: found {type(family).__name__}, expected TransferFunction, PolynomialNARX "
            "or a callable (order, degree) -> structure"
        )
    return family


def _decision(result: Identification) -> tuple[str, str]:
    """Kept where a consistent vector is proved, refuted where none is possible."""
    if result.empty:
        where = ", ".join(str(k) for _, k in result.samples[:6])
        return "refuted", "the feasible set is proved empty" + (
            f" by samples {where}" if where else ""
        )
    if all(item.inner is None for item in result.intervals.values()):
        return "open", "neither a consistent parameter vector nor emptiness was proved"
    widest = max(_relative(item) for item in result.intervals.values())
    if not np.isfinite(widest):
        return "kept", "consistent parameters exist; some intervals are not finite"
    return "kept", f"consistent parameters exist; widest interval {100 * widest:.2g} % of its size"


def _relative(item: ParameterInterval) -> float:
    """Half the width as a share of the largest magnitude."""
    size = max(abs(item.outer[0]), abs(item.outer[1]))
    return 0.5 * item.width / size if 0 < size < np.inf else (np.inf if size else 0.0)


def _coefficients(result: Identification) -> dict[str, str]:
    return {name: _sign_test(item) for name, item in result.intervals.items()}


def _sign_test(item: ParameterInterval) -> str:
    """Read the sign of a coefficient off its interval, if that can be trusted."""
    low, high = item.outer
    if low > 0 or high < 0:
        return f"needed: its sign is {'positive' if low > 0 else 'negative'}, proved"
    if item.status in (IntervalStatus.UNIDENTIFIABLE, IntervalStatus.UNBOUNDED):
        return f"open: {item.status}"
    if item.inner is None:
        return "open: no value is attained"
    if item.inner[0] <= 0 <= item.inner[1]:
        return "idle: both signs are attained, so that the data do not ask for it"
    if item.gap > 1.0:
        return (
            f"open: the gap is {item.gap:.2g} times the attained width, so its sign tells nothing"
        )
    return "open: zero is proved possible by no point and excluded by no proof"
