"""Parameters whose simulation stays within the noise bounds, and the ends they reach.

A fit of the outputs by Gauss-Newton steps in the largest error, relative to its bound: each step is
a linear program in the few parameters, within a trust region. From a fit that needs less noise than
there is, programs of the same size go to the end of each parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.proofs.simulated.forms import Form, Region
from setid.proofs.simulated.outputs import Recursion
from sparsepop_py.budget import Deadline
from sparsepop_py.lp.highs import LinearModel

__all__ = ["Fitting", "best_fit", "reached_ends"]

Reals = NDArray[np.float64]
_STARTS, _STEPS = 24, 60
_SEED = 7
_ROOM = 1e-7  # of the noise bounds: what points keep away from them
_NEAR = 1e-8  # of the box: gains for which no program is solved
_HALVINGS = 40
_LOWEST = 0.5  # of the largest error: what a step is not expected to go below


@dataclass(frozen=True, slots=True, eq=False)
class Fitting:
    """Errors of simulations relative to their bounds, and what parameters may be.

    Parameters
    ----------
    formulation : Formulation
    recursion : Recursion
        The record as a simulation.
    lower, upper : (d,) float
        Finite; first samples that no equation gives follow the parameters.
    """

    formulation: Formulation
    recursion: Recursion
    lower: Reals
    upper: Reals
    _given: tuple[Reals, Reals] = field(init=False)  # rows of priors and smoothed readings

    def __post_init__(self) -> None:
        given = self.recursion.cover(self.formulation, self.lower, self.upper)
        object.__setattr__(self, "_given", given)

    def errors(self, theta: Reals) -> tuple[Reals, Reals]:
        """Compute errors in noise bounds (R,), and their slopes (R, d)."""
        signals = self._run(theta)
        data, errors, slopes = self.formulation.data, [], []
        bound = self.formulation.noise.bounds(data).output
        for channel, name in enumerate(self.recursion.outputs):
            y, form = data.y[:, channel], signals[name]
            known = ~np.isnan(y) & np.isfinite(form.rest)
            unit = np.maximum(bound[known, channel], 1e-300)
            errors.append((y[known] - form.value[known]) / unit)
            slopes.append(-form.slope[known] / unit[:, None])
        return np.concatenate(errors), np.concatenate(slopes)

    def simulated(self, theta: Reals) -> dict[str, Reals]:
        """Simulate every signal (N,); NaN before the first sample that is asked."""
        every = self._run(theta).items()
        return {name: np.where(np.isinf(form.rest), np.nan, form.value) for name, form in every}

    def _run(self, theta: Reals) -> dict[str, Form]:
        nothing = np.zeros((0, theta.size))
        return self.recursion.run(
            Region(theta, theta, nothing, np.zeros(0), np.zeros(0)), bounded=False
        )

    def level(self, theta: Reals) -> float:
        """Compute the largest error in noise bounds; infinite where it is no number."""
        found = np.abs(self.errors(theta)[0])
        return float(found.max()) if np.all(np.isfinite(found)) else np.inf

    def step(self, theta: Reals, radius: Reals, goal: Reals | None) -> Reals | None:
        """Solve a linear program around theta: least error, or least goal within the bounds."""
        error, slope = self.errors(theta)
        if not (np.all(np.isfinite(error)) and np.all(np.isfinite(slope))):
            return None
        p = theta.size
        ends = np.maximum(self.lower - theta, -radius), np.minimum(self.upper - theta, radius)
        far = np.maximum(np.abs(ends[0]), np.abs(ends[1]))
        room = 0.0 if goal is None else 1.0 - _ROOM
        least = _LOWEST * float(np.abs(error).max()) if goal is None else room
        close = np.abs(error) + np.abs(slope) @ far >= least  # others cannot bind
        error, slope = error[close], slope[close]
        level = np.ones(error.size) if goal is None else np.zeros(error.size)
        matrix, most = self._given
        most = most - matrix @ theta
        cuts = np.abs(matrix) @ far > most
        matrix, most = matrix[cuts], most[cuts]
        table = np.block(
            [
                [slope, -level[:, None]],
                [-slope, -level[:, None]],
                [matrix, np.zeros((most.size, 1))],
            ]
        )
        right = np.concatenate([room - error, room + error, most])
        last = (0.0, np.inf) if goal is None else (0.0, 0.0)
        columns = np.append(ends[0], last[0]), np.append(ends[1], last[1])
        model = LinearModel(sps.csr_array(table), (np.full(right.size, -np.inf), right), columns)
        cost = np.append(np.zeros(p), 1.0) if goal is None else np.append(goal, 0.0)
        found = model.solve(cost)
        return np.asarray(found.x[:p], np.float64) if found.status == "solved" else None


def best_fit(
    fitting: Fitting, deadline: Deadline, first: Reals | None = None
) -> tuple[Reals, float]:
    """Minimise the largest error from several starts.

    Parameters
    ----------
    fitting : Fitting
    deadline : Deadline
    first : (d,) float, optional
        The start that is tried first; the middle when left out.

    Returns
    -------
    (p,) float, float
        The best parameters that are found, and their largest error in noise bounds.
    """
    random = np.random.default_rng(_SEED)
    low, high = fitting.lower, fitting.upper
    best, least = low / 2 + high / 2 if first is None else np.clip(first, low, high), np.inf
    for number in range(_STARTS):
        begin = random.uniform(low, high) if number else best
        found, level = _fitted(fitting, begin, deadline)
        if level < least:
            best, least = found, level
        if least < 1.0 or deadline.over:
            break
    return best, least


def _fitted(fitting: Fitting, theta: Reals, deadline: Deadline) -> tuple[Reals, float]:
    width = fitting.upper - fitting.lower
    level, radius = fitting.level(theta), 0.5 * width
    for _ in range(_STEPS):
        if deadline.over:
            break
        step = fitting.step(theta, radius, None)
        if step is None:
            break
        trial = theta + step
        reached = fitting.level(trial)
        if reached < level:
            gain, theta, level = level - reached, trial, reached
            radius = np.minimum(2.0 * radius, width)
            if gain < 1e-6 * level:
                break
        else:
            radius = 0.25 * np.minimum(radius, np.abs(step).max() / width.max() * width + 1e-300)
            if np.all(radius < 1e-9 * width):
                break
    return theta, level


def reached_ends(
    fitting: Fitting, inside: Reals, deadline: Deadline, count: int | None = None
) -> list[Reals]:
    """Search consistent parameters at the ends of each unknown, as far as found.

    Parameters
    ----------
    fitting : Fitting
    inside : (d,) float
        Consistent, with some room.
    deadline : Deadline
    count : int, optional
        How many unknowns, the first ones; all when left out.

    Returns
    -------
    list of (d,) float
        The least and the largest of each unknown in turn, and ``inside`` where none is found.
    """
    found = []
    for place in range(inside.size if count is None else count):
        for sign in (1.0, -1.0):
            goal = sign * np.eye(inside.size)[place]
            found.append(_end(fitting, inside, goal, deadline))
    return found


def _end(fitting: Fitting, inside: Reals, goal: Reals, deadline: Deadline) -> Reals:
    theta, radius = inside, fitting.upper - fitting.lower
    for _ in range(_STEPS):
        if deadline.over:
            break
        step = fitting.step(theta, radius, goal)
        if step is None:
            break
        trial = _consistent(fitting, theta, theta + step, goal)
        gain, hoped = float(goal @ (theta - trial)), float(goal @ -step)
        if gain > 0.0:
            theta = trial
        if gain < 0.5 * hoped:
            radius = 0.25 * np.maximum(np.abs(step), 1e-3 * np.minimum(radius, 1.0))
        if hoped <= _NEAR * float(np.abs(goal) @ (fitting.upper - fitting.lower)):
            break
    return theta


def _consistent(fitting: Fitting, theta: Reals, trial: Reals, goal: Reals) -> Reals:
    """Correct a trial to the noise bounds, else go back towards theta, which is within them."""
    enough, radius = 1.0 - 0.5 * _ROOM, np.abs(trial - theta).max() * np.ones(theta.size) + 1e-300
    for _ in range(4):
        if fitting.level(trial) <= enough:
            return trial
        back = fitting.step(trial, radius, goal)
        if back is None:
            break
        trial = trial + back
    if fitting.level(trial) <= enough:
        return trial
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        inside = fitting.level(theta + share * (trial - theta)) <= enough
        low, high = (share, high) if inside else (low, share)
        if high - low < 1e-4:
            break
    return theta + low * (trial - theta)
