"""The structure loop: the simplest structure that the data do not refute, step by step.

From the smallest order and degree upwards, a structure is left only when the data prove it
wrong (its feasible set is empty). The first one with a consistent parameter vector is kept;
its intervals then say which coefficients are needed. A sign is trusted only where it is
settled: a gap as wide as the attained interval tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from itertools import product
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

import sparsepop_py as sp
from setid.analysis.terms import sparse_terms, without, without_idle
from setid.consistency import consistency
from setid.data.checks import asked, entries_of, natural, number, switch
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, SetidError, warns_once
from setid.html import listing, section, table
from setid.identify import identify
from setid.minimum_noise.conflicting_samples import samples_listed
from setid.models.equations import Structure
from setid.models.registry import family_of
from setid.options import Options, check_executor, checked_options, limited
from setid.priors.base import Prior, listed
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.result.identification import Identification
from sparsepop_py.budget import Deadline
from sparsepop_py.executors.dispatch import completed
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Selection", "SelectionStep", "select"]

Family = Callable[[int, int], Structure]
_WORK = 30.0  # units for a least noise level, where there is no limit
_NOT_FINITE = "some intervals are not finite"
_GAIN = 0.7  # of the noise that another structure needs, for it to be worth while


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
        excludes zero, proved), ``"idle"`` (zero is attained, or lies between attained values) or
        ``"open"``, with the reason.
    advice : str
        Where intervals are wider than asked: whether a better sensor or another structure pays, or
        that this is open.

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
    advice: str = ""

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
        lines += [self.advice] if self.advice else []
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


@warns_once
def select(
    data: IOData,
    family: str | type | Family,
    noise: Noise,
    orders: Iterable[int],
    degrees: Iterable[int] = (1,),
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    options: Options | None = None,
    *,
    remove_idle: bool = False,
    l1: bool = False,
    width: float | None = None,
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
        For each identification; limits in time are for the whole call, and the log says what
        there was no time for.
    remove_idle : bool
        Leave out terms of which both signs, or zero, are attained, and identify again, until all
        that are left are needed or open.
    l1 : bool
        Leave out the terms that are zero where the sum of sizes is least, before anything is
        identified: for dictionaries of many terms. That the others explain the record is
        proved by the identification; where they do not, the whole structure is tried.
    width : float, optional
        Largest half width, relative, that is wanted. Where intervals are wider, ``advice`` says
        whether a better sensor or a higher degree pays, from the least noise that explains the
        record with this structure and with the next: of those to try, else of one more degree, or
        of one more order where a degree makes no difference.
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
    remove_idle, l1 = (
        switch(given, name, SetidError)
        for name, given in (("remove_idle", remove_idle), ("l1", l1))
    )
    if width is not None and not number(width, "width", SetidError) > 0:
        raise SetidError(f"width: found {width!r}, expected a number > 0")
    check_executor(executor)
    if not isinstance(data, IOData):
        raise DataError(f"data: found {type(data).__name__}, expected IOData")
    make = _family(family, data)
    sizes = _naturals(orders, "orders", 0)
    tops = _naturals(degrees, "degrees", 1)
    if not sizes or not tops:
        raise SetidError("orders, degrees: found none, expected at least one of each")
    known, settings = listed(priors), checked_options(options)
    tried = list(product(sizes, tops))
    given = data, noise, known, settings
    deadline, stages = settings.limits(), 1 + remove_idle + (width is not None)
    search = deadline.part(1.0 / stages)
    found = (
        _in_turn(make, tried, given, l1, search)
        if executor is None
        else _at_once(make, tried, given, l1, search, executor)
    )
    steps = list[SelectionStep]()
    with closing(found):
        for step in found:
            steps.append(step)
            if step.result.interrupted:
                deadline.stop()
            if step.decision == "kept" or deadline.stopped:
                break
    if steps[-1].decision != "kept":
        return Selection(tuple(steps), None, {})
    removal = deadline.part(1.0 if width is None else 0.5)
    more, untried = _without_idle(step, given, removal) if remove_idle else ([], ())
    last = next((s for s in reversed([step, *more]) if s.decision == "kept"), step)
    behind = tried[len(steps) :]
    advice = "" if width is None else _width(last, width, make, behind, given, deadline)
    return Selection((*steps, *more), last, _coefficients(last.result, untried), advice)


_Given = tuple[IOData, Noise, list[Any], Options]
_Steps = Generator[SelectionStep, None, None]


def _in_turn(
    make: Family, tried: list[tuple[int, int]], given: _Given, l1: bool, deadline: Deadline
) -> _Steps:
    """Try one structure after the other; those soon refuted leave their time to the others."""
    data, noise, known, settings = given
    for place, sizes in enumerate(tried):
        timed = settings.within(deadline, 1.0 / (len(tried) - place))
        yield _try((make(*sizes), sizes, (data, noise, known, timed), l1))


def _at_once(
    make: Family,
    tried: list[tuple[int, int]],
    given: _Given,
    l1: bool,
    deadline: Deadline,
    executor: Executor,
) -> _Steps:
    """Try all structures at once; yield them in their order."""
    data, noise, known, settings = given
    settings = replace(settings.within(deadline, 1.0 / len(tried)), progress=False)
    sent = (data, noise, known, settings)
    tasks = ((k, (make(*sizes), sizes, sent, l1)) for k, sizes in enumerate(tried))
    ready: dict[int, SelectionStep] = {}
    place = 0
    with closing(completed(executor, _try, tasks)) as found:
        for done in found:
            if done.value is None:
                raise SetidError(f"executor: structure {tried[done.key]} was given up: {done.lost}")
            ready[done.key] = done.value
            while place in ready:
                yield ready.pop(place)
                place += 1


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
    try:
        signature(family).bind(1, 1)
    except TypeError as error:
        raise ModelError(
            f"family: found a callable of other arguments ({error}), expected (order, degree) -> "
            "structure"
        ) from None
    except ValueError:  # of compiled functions nothing is known
        pass
    return lambda order, degree: asked("family", partial(family, order, degree), ModelError)


def _try(task: tuple[Structure, tuple[int, int], _Given, bool]) -> SelectionStep:
    """Identify one structure; in a worker process if there is an executor."""
    whole, (order, degree), (data, noise, priors, options), l1 = task
    deadline = options.limits()
    names = sparse_terms(data, whole, noise) if l1 else ()
    if names:  # fewer terms that explain the record: then all of them do
        model, fixed = without(whole, names)
        half = options.within(deadline, 0.5)
        result = identify(data, model, noise, [*priors, *fixed], half)
        decision, reason = _decision(result)
        if decision == "kept":
            text = f"without {len(names)} of {len(whole.parameters)} terms: {reason}"
            return SelectionStep(order, degree, decision, text, result)
    result = identify(data, whole, noise, priors, options.within(deadline))
    return SelectionStep(order, degree, *_decision(result), result)


def _without_idle(
    step: SelectionStep, given: _Given, deadline: Deadline
) -> tuple[list[SelectionStep], tuple[str, ...]]:
    """Steps that leave idle terms out of a structure that was kept, and terms not tried in time."""
    data, noise, priors, options = given
    fixed = step.result.formulation.priors[len(priors) :]
    tried, untried = without_idle(step.result, (data, noise, [*priors, *fixed], options), deadline)
    return [_without_step(step, found.left_out, found.result) for found in tried], untried


def _without_step(
    step: SelectionStep, names: Sequence[str], result: Identification
) -> SelectionStep:
    decision, reason = _decision(result)
    text = f"without {', '.join(names)}: {reason}"
    return SelectionStep(step.order, step.degree, decision, text, result)


def _width(
    step: SelectionStep,
    width: float,
    make: Family,
    behind: Sequence[tuple[int, int]],
    given: _Given,
    deadline: Deadline,
) -> str:
    """Say whether noise or structure makes intervals wide."""
    widest = max(_relative(item) for item in step.result.intervals.values())
    shown = _NOT_FINITE if widest == inf else f"widest interval {100 * widest:.2g} % of its size"
    if widest <= width:
        return f"{shown}: as narrow as asked"
    shown += f", {100 * width:.2g} % asked"
    if deadline.late:
        return f"{shown}; there was no time to find out whether noise or structure makes it wide"
    found = _following(make, (step.order, step.degree), behind)
    if found is None:
        return f"{shown}; no other structure was found to compare the noise with that it needs"
    data, noise, priors, options = given
    (order, degree), following = found
    if deadline.unlimited:
        options = limited(Deadline.before(inf, _WORK), options)
    known, half = step.result.formulation, options.within(deadline, 0.5)
    own = consistency(data, known.model, noise, known.priors, half).scale  # terms left out stay out
    other = consistency(data, following, noise, priors, options.within(deadline)).scale
    return (
        f"{shown}; this structure needs {_times(own)} the noise bounds, order {order}, "
        f"degree {degree} needs {_times(other)}: {_what_pays(own, other)}"
    )


def _following(
    make: Family, sizes: tuple[int, int], behind: Sequence[tuple[int, int]]
) -> tuple[tuple[int, int], Structure] | None:
    """Make the next structure that is another one: of those to try, or of more degree or order."""
    order, degree = sizes
    own = _told_apart(make(order, degree))
    for larger in [*behind, (order, degree + 1), (order + 1, degree)]:
        try:
            found = make(*larger)
        except ModelError:  # a family may have none of sizes that were not asked for
            if larger in behind:
                raise
            continue
        if _told_apart(found) != own:
            return larger, found
    return None


def _told_apart(model: Structure) -> tuple[str, tuple[str, ...]]:
    return repr(model), tuple(model.parameters)


def _times(scale: tuple[float, float]) -> str:
    """A least factor on the noise bounds between its proved and its attained end."""
    low, high = rounded(scale[0], False, 2), rounded(scale[1], True, 2)
    return f"{low} to {high} times" if scale[1] < inf else f"at least {low} times"


def _what_pays(own: tuple[float, float], other: tuple[float, float]) -> str:
    """Compare the least factors of a structure and of the next one, where they are known."""
    if other[1] < _GAIN * own[0]:
        return "a higher degree or order pays, with lower bounds"
    if _GAIN * own[1] <= other[0]:
        return "a better sensor or more excitation pays"
    return "which of structure and sensor pays stayed open: give more time"


def _decision(result: Identification) -> tuple[str, str]:
    """Kept where a consistent vector is proved, refuted where none is possible."""
    if result.empty:
        where = samples_listed(result.samples, result.formulation.data.records)
        return "refuted", "the feasible set is proved empty" + (
            f" by samples {where}" if where else ""
        )
    if all(item.inner is None for item in result.intervals.values()):
        found = "neither a consistent parameter vector nor emptiness was proved"
        return "open", found + _notes_on(result)
    widest = max(_relative(item) for item in result.intervals.values())
    if not np.isfinite(widest):
        return "kept", f"consistent parameters exist; {_NOT_FINITE}"
    return "kept", f"consistent parameters exist; widest interval {100 * widest:.2g} % of its size"


def _notes_on(result: Identification) -> str:
    """Say whether time ended the search, and what the result notes of it."""
    limited = any(one.status is sp.Status.LIMIT for one in result.results)
    notes = [*(["time ended first"] if limited else []), *result.notes]
    return f" ({'; '.join(notes)})" if notes else ""


def _relative(item: ParameterInterval) -> float:
    """Half the width as a share of the largest magnitude."""
    size = max(abs(item.outer[0]), abs(item.outer[1]))
    return 0.5 * item.width / size if 0 < size < np.inf else (np.inf if size else 0.0)


def _coefficients(result: Identification, untried: Sequence[str]) -> dict[str, str]:
    found = {name: _sign_test(item) for name, item in result.intervals.items()}
    return found | {n: f"{found[n]}; there was no time to leave it out" for n in untried}


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
        both = item.inner[0] < 0 < item.inner[1]
        shown = "both signs are attained" if both else "zero is attained"
        return f"idle: {shown}, so that the data do not ask for it"
    if item.gap > 1.0:
        return (
            f"open: the gap is {item.gap:.2g} times the attained width, so its sign tells nothing"
        )
    return "open: zero is proved possible by no point and excluded by no proof"
