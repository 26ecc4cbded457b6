"""Incremental stability of trained networks, with a decay rate and bounds for all time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid import IOData, ModelError, Verification
from setid.data.checks import natural, number, real_array, switch
from setid.data.digits import all_digits
from setid.neural.arithmetic import Interval, at_least, down, quiet_overflow, require_ieee, up
from setid.neural.contraction.comparison import (
    Comparison,
    comparisons,
    contraction,
    output_slopes,
    rate_of,
)
from setid.neural.contraction.lmi import (
    Lyapunov,
    difference_system,
    find_lyapunov,
    prove_lyapunov,
    size_bounds,
)
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.models.regressor import RegressorNetwork
from setid.neural.status import Status, agreed
from setid.proofs.evidence import as_verdict
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Condition", "Stability", "stability"]

Reals = NDArray[np.float64]
_MOST = 10**6  # steps of a distance
Model = Elman | NeuralStateSpace | LSTM | GRU | RegressorNetwork


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """One sufficient condition and what it proves.

    Parameters
    ----------
    name : str
        The condition with its source.
    holds : bool
        False means that this condition decides nothing.
    rate : float
        Factor by which the weighted norm of a difference shrinks each step; at least 1 where
        the condition fails.
    norm : {"2", "inf", "entries", "P"}
        Of the differences, see :meth:`Stability.distance`.
    weights : (k,) float
        The norm is max_i v_i / weights_i over blocks v of the state.
    drive, error : (k,) float
        Gains from bounds of input differences and of errors to v.
    lyapunov : Lyapunov or None
        The matrices, for norm ``"P"``.
    """

    name: str
    holds: bool
    rate: float
    norm: str
    weights: Reals
    drive: Reals
    error: Reals
    lyapunov: Lyapunov | None = None

    def __repr__(self) -> str:
        word = "holds" if self.holds else "open"
        return f"{self.name}: {word}, rate {rounded(self.rate, True, 6)}"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Stability:
    """Verdict on incremental stability, with the conditions that were tried.

    Parameters
    ----------
    net : a model of this room
    inputs : Interval (nu,) or None
        Range of the inputs for which it holds; None for all inputs.
    status : Status
        ``"stable"``: incrementally input-to-state stable, proved; ``"open"`` otherwise, which
        does not mean unstable.
    conditions : tuple of Condition
        All that were tried.
    assumptions : tuple of str
    """

    net: Model
    inputs: Interval | None
    status: Status
    conditions: tuple[Condition, ...]
    assumptions: tuple[str, ...]

    @property
    def best(self) -> Condition:
        """The condition of least rate among those that hold.

        Raises
        ------
        ModelError
            If none holds.
        """
        good = [item for item in self.conditions if item.holds]
        if not good:
            raise ModelError("stability: found no condition that holds, so that no rate is proved")
        return min(good, key=lambda item: item.rate)

    @property
    def rate(self) -> float:
        """Proved decay rate of differences, below 1; infinite where nothing is proved."""
        return self.best.rate if self.status is Status.STABLE else np.inf

    def _chosen(self, condition: Condition | None) -> Condition:
        """Choose a condition that holds, the best where none is given.

        Of others no bound is for all time.
        """
        if condition is None:
            return self.best
        if not isinstance(condition, Condition) or not condition.holds:
            raise ModelError(
                f"condition: found {condition!r:.60}, expected one of `conditions` that holds"
            )
        return condition

    @quiet_overflow
    def distance(
        self,
        steps: int,
        initial: float,
        inputs: float = 0.0,
        errors: float = 0.0,
        condition: Condition | None = None,
    ) -> Reals:
        """Bound the distance of the states of two simulations for each step.

        Parameters
        ----------
        steps : int
        initial : float
            Bound of the distance of the initial states: in the Euclidean norm of each block
            (layers of Elman, cells and outputs of LSTM) for conditions in the 2-norm, of the whole
            state for the LMI, as the largest entry for the others.
        inputs : float
            Bound of the distance of the inputs at each step, in the same norm.
        errors : float
            Bound of errors added to the state of one run at each step, in the same norm. For
            LSTM and GRU the state has to stay in its range with them, see ``assumptions``.
        condition : Condition, optional
            One that holds; that of least rate where left out.

        Returns
        -------
        (steps + 1,) float
            In the same norm, of the largest block. It never exceeds :meth:`limit` plus the first
            value, for all time.
        """
        found = self._chosen(condition)
        count = natural(steps, "steps", ModelError, 0, _MOST)
        reach, drive, show = _scales(found, inputs, errors)
        value = up(reach * _size(initial, "initial"))
        values = [value]
        for _ in range(count):
            value = up(up(found.rate * value) + drive)
            values.append(value)
        return np.asarray(up(show * np.array(values)), np.float64)

    @quiet_overflow
    def limit(
        self, inputs: float = 0.0, errors: float = 0.0, condition: Condition | None = None
    ) -> float:
        """Bound what remains of the distance after the initial difference is forgotten.

        Parameters
        ----------
        inputs, errors, condition
            As for :meth:`distance`.
        """
        found = self._chosen(condition)
        _, drive, show = _scales(found, inputs, errors)
        return float(up(show * up(drive / down(1.0 - found.rate))))

    @quiet_overflow
    def output_distance(
        self, steps: int, initial: float, inputs: float = 0.0, errors: float = 0.0
    ) -> Reals:
        """Bound the distance of the outputs, largest entry; conditions with the LMI excluded.

        Parameters
        ----------
        steps, initial, inputs, errors
            As for :meth:`distance`.

        Returns
        -------
        (steps + 1,) float
            Entry t is about outputs that are read from the states after t steps. For a state space
            these are the outputs of sample t. Other models step first: theirs are those of sample
            t - 1, and entry 0 is about no output.
        """
        good = [item for item in self.conditions if item.holds and item.norm != "P"]
        if not good:
            raise ModelError("stability: found no norm condition that holds")
        found = min(good, key=lambda item: item.rate)
        states = self.distance(steps, initial, inputs, errors, found)
        gains, direct = output_slopes(self.net, found.norm)
        total = up(float(np.sum(gains)) * (1.0 + 1e-12))
        return np.asarray(up(up(total * states) + up(direct * inputs)), np.float64)

    @as_verdict
    def verify(self) -> Verification:
        """Check all conditions that hold again, without any solver."""
        require_ieee()
        if not _suits(self.net, self.inputs):
            return Verification(False, "the range of the inputs is none that the network asks for")
        if not set(_assumptions(self.net, self.inputs)) <= set(self.assumptions):
            return Verification(False, "an assumption is left out")
        known = {item.name: item for item in comparisons(self.net, self.inputs)}
        for item in self.conditions:
            if not item.holds:
                continue
            verdict = _verify(self.net, item, known.get(item.name))
            if not verdict:
                return verdict
        stable = any(item.holds for item in self.conditions)
        wanted = Status.STABLE if stable else Status.OPEN
        return agreed((self.status is wanted, "the status does not follow"))

    def __repr__(self) -> str:
        if self.status is not Status.STABLE:
            return f"<Stability: {self.status}, {len(self.conditions)} conditions fail>"
        return f"<Stability: {self.status}, {self.best!r}>"


@quiet_overflow
def stability(net: Model, inputs: ArrayLike | IOData | None = None, lmi: bool = True) -> Stability:
    """Prove incremental input-to-state stability by norm conditions and one LMI.

    Parameters
    ----------
    net : Elman, NeuralStateSpace, LSTM, GRU, NNOE or NNARX
        A regressor network is taken in simulation.
    inputs : (nu, 2) or (2,) array_like, or IOData, optional
        Range of the inputs, which LSTM and GRU need: [-1, 1] where left out. A record gives the
        range of its readings.
    lmi : bool
        Whether to try the linear matrix inequality too.

    Returns
    -------
    Stability

    Raises
    ------
    ModelError
        If the network is of no kind listed, or the range does not fit.

    References
    ----------
    E. Terzi, F. Bonassi, M. Farina, R. Scattolini, International Journal of Robust and Nonlinear
    Control 31 (2021); F. Bonassi, M. Farina, R. Scattolini, Systems & Control Letters 157 (2021).

    Examples
    --------
    >>> from setid import neural
    >>> net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[2.0]], [0.0]))
    >>> found = neural.stability(net)
    >>> found.status, round(found.rate, 3), bool(found.verify())
    (<Status.STABLE: 'stable'>, 0.5, True)
    """
    require_ieee()
    if not isinstance(net, (Elman, NeuralStateSpace, LSTM, GRU, RegressorNetwork)):
        raise ModelError(f"net: found {type(net).__name__}, expected a model of setid.neural")
    tries = switch(lmi, "lmi", ModelError)
    box = _range(net, inputs)
    found = [_condition(item) for item in comparisons(net, box)]
    if tries and not isinstance(net, (LSTM, GRU)):
        found.append(_by_lmi(net))
    status = Status.STABLE if any(item.holds for item in found) else Status.OPEN
    return Stability(net, box, status, tuple(found), _assumptions(net, box))


def _suits(net: Model, inputs: Interval | None) -> bool:
    """Check for a finite range of each input where the network is gated, and else for none."""
    if not isinstance(net, (LSTM, GRU)):
        return inputs is None
    if not isinstance(inputs, Interval):
        return False
    if not inputs.lo.shape == inputs.hi.shape == (net.channels,):
        return False
    return bool(np.all(np.isfinite([inputs.lo, inputs.hi])) and np.all(inputs.lo <= inputs.hi))


def _range(net: Model, inputs: Any) -> Interval | None:
    if not isinstance(net, (LSTM, GRU)):
        return None
    if isinstance(inputs, IOData):
        inputs = np.column_stack([np.nanmin(inputs.u, axis=0), np.nanmax(inputs.u, axis=0)])
    values = real_array([[-1.0, 1.0]] if inputs is None else inputs, "inputs", ModelError)
    try:
        values = np.broadcast_to(values, (net.channels, 2)).copy()
    except ValueError:
        raise ModelError(
            f"inputs: found shape {values.shape}, expected ({net.channels}, 2) or (2,)"
        ) from None
    if not np.all(values[:, 0] <= values[:, 1]) or not np.all(np.isfinite(values)):
        raise ModelError(f"inputs: found {values.tolist()}, expected (low, high), low <= high")
    return Interval(values[:, 0], values[:, 1])


def _assumptions(net: Model, box: Interval | None) -> tuple[str, ...]:
    found = [
        "a statement about the plant needs: plant state = network step + bounded error, whose "
        "bound is given to distance()"
    ]
    if box is not None:
        pairs = zip(box.lo, box.hi, strict=True)
        ends = ", ".join(f"[{all_digits(a)}, {all_digits(b)}]" for a, b in pairs)
        found.append(f"the inputs lie in {ends} at all times")
    # a step without errors stays in these ranges, errors may leave them, and gates with them
    times = "in both runs, at the beginning, and at all times where errors are added"
    if isinstance(net, LSTM):
        found.append(f"h in [-1, 1] and c in its invariant range {times}")
    if isinstance(net, GRU):
        found.append(f"h in [-1, 1] {times}")
    return tuple(found)


def _condition(item: Comparison) -> Condition:
    found = contraction(item.matrix)
    holds = found.rate < 1.0
    return Condition(item.name, holds, found.rate, item.norm, found.weights, item.drive, item.error)


def _by_lmi(net: Elman | NeuralStateSpace | RegressorNetwork) -> Condition:
    name = "LMI with slope-restricted activations"
    one = np.ones(1)
    try:
        found = find_lyapunov(difference_system(net))
    except sp.SolverNotFound as error:
        return Condition(f"{name} (not tried: {error})", False, np.inf, "P", one, one * np.inf, one)
    if found is None:
        return Condition(name, False, np.inf, "P", one, one * np.inf, one)
    return Condition(name, True, found.rate, "P", one, _input_gain(net), one, found)


def _input_gain(net: Elman | NeuralStateSpace | RegressorNetwork) -> Reals:
    """Euclidean gain from an input difference to the next state, shape (1,)."""
    for item in comparisons(net, None):
        if item.norm == "2":
            return np.array([up(np.sqrt(up(np.sum(item.drive**2) * (1.0 + 1e-12))))])
    (item,) = comparisons(net, None)  # entry by entry: bounded inputs, largest entry
    return np.array([up(np.sqrt(up(np.sum(item.drive**2) * (1.0 + 1e-12))))])


def _size(given: float, field: str) -> float:
    """Read the bound of a distance."""
    value = number(given, field, ModelError)
    if value < 0.0:
        raise ModelError(f"{field}: found {given!r}, expected a number >= 0")
    return value


def _scales(item: Condition, inputs: float, errors: float) -> tuple[float, float, float]:
    """From the initial distance, to the drive, and back to the norm that is shown."""
    fed, added = _size(inputs, "inputs"), _size(errors, "errors")
    push = up(up(item.drive * fed) + up(item.error * added))
    if item.lyapunov is not None:
        low, high = size_bounds(item.lyapunov.P)
        root = float(up(np.sqrt(high)))
        show = float(up(1.0 / down(np.sqrt(low)))) if low > 0 else np.inf
        return root, float(up(root * push[0])), show
    most, least = float(np.max(item.weights)), float(np.min(item.weights))
    return float(up(1.0 / least)), float(np.max(up(push / item.weights))), most


def _verify(net: Model, item: Condition, known: Comparison | None) -> Verification:
    if item.lyapunov is not None:
        if isinstance(net, (LSTM, GRU)):
            return Verification(False, "no linear matrix inequality is about gated networks")
        return agreed(
            (item.norm == "P", "the norm is not that of the matrices"),
            (item.lyapunov.rate == item.rate, "the rate is not that of the matrices"),
            (prove_lyapunov(difference_system(net), item.lyapunov), "the inequality fails"),
            (at_least(item.drive, _input_gain(net)), "the gain of the inputs"),
            (at_least(item.error, np.ones(1)), "the gain of the errors"),
        )
    if known is None:
        return Verification(False, f"{item.name}: no such condition")
    good = item.weights.shape == known.drive.shape and bool(np.all(item.weights > 0))
    return agreed(
        (good, f"{item.name}: the weights"),
        (good and rate_of(known.matrix, item.weights) <= item.rate < 1.0, f"{item.name}: the rate"),
        (at_least(item.drive, known.drive), f"{item.name}: the gain of the inputs"),
        (at_least(item.error, known.error), f"{item.name}: the gain of the errors"),
        (item.norm == known.norm, f"{item.name}: the norm"),
    )
