"""Signals that difference equations define: by filters where they allow it, else by samples.

An equation is a filter,

    y(k)  =  f(k) - sum_i a_i y(k-i),

where y is in no product and the signals in f are known before. The samples of y are the solution of
one triangular system, whose matrix has the a_i beside its diagonal. Equations that need each other,
or products of a signal with its own past, are solved sample by sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtbsv

from setid.errors import ModelError
from setid.models.equations import Equation, Term

__all__ = ["leading", "solve_equations"]

Reals = NDArray[np.float64]


class _Step(NamedTuple):
    """One equation with numbers: target = (drive + sum of weight times lagged signals) / lead."""

    target: str
    lead: float
    terms: list[tuple[float, list[tuple[str, int]]]]
    drive: Reals | None

    def is_filter(self, known: set[str]) -> bool:
        """Check that all signals but its own are known, and that its own enters linearly."""
        for _, factors in self.terms:
            others = [name for name, _ in factors if name != self.target]
            own = len(factors) - len(others)
            if own > 1 or (own and others) or not known.issuperset(others):
                return False
        return True


def solve_equations(
    equations: Sequence[Equation],
    theta: Mapping[str, float],
    signals: dict[str, Reals],
    first: int,
    drives: Mapping[str, Reals],
) -> None:
    """Compute the signals that equations define, from a sample on, in place.

    Parameters
    ----------
    equations : sequence of Equation
        Each needs at lag 0 only what is given or defined before it.
    theta : mapping of str to float
    signals : dict of str to (N,) float
        All of them; those that are defined hold their first samples.
    first : int
        Sample from which on they are computed, at least the largest lag.
    drives : mapping of str to (N,) float
        What is added to the equation of a signal, for some of them.

    Raises
    ------
    ModelError
        If an equation does not give its sample.
    """
    steps = [
        _Step(
            equation.defines,
            leading(equation, theta),
            [
                (-_weight(term, theta), [(s.signal, s.lag) for s in term.signals])
                for term in equation.explicit
            ],
            drives.get(equation.defines),
        )
        for equation in equations
    ]
    known = set(signals) - {step.target for step in steps}
    with np.errstate(over="ignore", invalid="ignore"):
        for count, step in enumerate(steps):
            if not step.is_filter(known):
                _by_samples(steps[count:], signals, first)
                return
            _filter(step, signals, first)
            known.add(step.target)


def _filter(step: _Step, signals: dict[str, Reals], first: int) -> None:
    """Solve one equation for all samples from the first one on."""
    target = signals[step.target]
    force = np.zeros(target.size - first) if step.drive is None else step.drive[first:].copy()
    feedback = np.zeros(max((lag for _, f in step.terms for _, lag in f), default=0))
    for weight, factors in step.terms:
        if factors and factors[0][0] == step.target:
            feedback[factors[0][1] - 1] -= weight / step.lead
        else:
            parts = [signals[name][first - lag : target.size - lag] for name, lag in factors]
            force += weight * math.prod(parts, start=np.ones(force.size))
    force /= step.lead
    if force.size and np.any(feedback):
        for lag, a in enumerate(feedback.tolist(), 1):  # of samples before the first one
            before = target[first - lag : first][: force.size]
            force[: before.size] -= a * before
        rows = np.ones((1 + feedback.size, force.size), order="F")
        rows[1:] = feedback[:, None]
        force = dtbsv(feedback.size, rows, force, lower=1, diag=1)
    target[first:] = force


def _by_samples(steps: Sequence[_Step], signals: dict[str, Reals], first: int) -> None:
    """Go through the samples, and through the equations at each."""
    lists = {name: values.tolist() for name, values in signals.items()}
    size = len(lists[steps[0].target])
    rows: list[tuple[list[float], float, list[float], list[Any]]] = [
        (
            lists[step.target],
            step.lead,
            [0.0] * size if step.drive is None else step.drive.tolist(),
            [(weight, [(lists[name], lag) for name, lag in f]) for weight, f in step.terms],
        )
        for step in steps
    ]
    for k in range(first, size):
        for target, lead, drive, terms in rows:
            value = drive[k]
            for product, factors in terms:
                for samples, lag in factors:
                    product *= samples[k - lag]
                value += product
            target[k] = value / lead
    for step in steps:
        signals[step.target][:] = lists[step.target]


def _weight(term: Term, theta: Mapping[str, float]) -> float:
    """Compute the factor of the signals of a term."""
    return float(term.coefficient) * math.prod((theta[name] for name in term.parameters), start=1.0)


def leading(equation: Equation, theta: Mapping[str, float]) -> float:
    """Compute the factor of the defined sample: 1, unless the equation is implicit.

    Raises
    ------
    ModelError
        If it is zero, so that the equation does not give the sample.
    """
    value = 1.0 + sum(_weight(term, theta) for term in equation.implicit)
    if value == 0.0:
        raise ModelError(
            f"theta: found a factor of zero before {equation.defines} at the same sample, "
            "expected parameters with which the equation gives it"
        )
    return value
