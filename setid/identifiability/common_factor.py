"""Sets that are unbounded since a simpler structure explains the data as well.

**A common factor.** If (A', B') of one order less is consistent, then so is
(A' (1 + c q^-1), B' (1 + c q^-1)) for every c, with the same noise: row k of the higher order is
row k plus c times row k - 1 of the lower one.

**A delay less.** Let (A', B') with one pole less, and an input that acts one sample sooner, hold
for true outputs w with noise strictly inside its bounds (the last output of each record left out).
Then (1 + c q^-1 A', c q^-1 B') is consistent for every large |c|: its rows are
w_k + c (A' w - B' u)_{k-1} = 0, and hold for w + d if (A' d)_{k-1} = -(w_k + d_k) / c. From d = 0
before, that is a contraction of rate g / |c|, g the sum of the impulse response of 1 / A' over the
record, with |d| <= g max |w| / (|c| - g): less than what the noise has to spare once |c| is large.

Coefficients that change with c take values of any size and both signs.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.data.noise import Noise
from setid.errors import ModelError
from setid.feasible_points.estimators import least_squares, linf
from setid.feasible_points.start import first_point
from setid.formulation.formulation import Formulation, formulate
from setid.minimum_noise.factor import nearby, scaled_noise
from setid.models.lti import TransferFunction
from setid.proofs.existence import consistent

__all__ = ["Endless", "endless_by"]

_SECONDS = 5.0  # for the engine to find a consistent vector of each simpler structure
_WIDE = 2.0  # times the noise bounds: where the engine begins
_INSIDE = 1.0 - 2.0**-16  # of the noise bounds: strictly inside, by however little


@dataclass(frozen=True, slots=True, eq=False)
class Endless:
    """A simpler structure that explains the data, and the parameters that it makes unbounded.

    Parameters
    ----------
    names : tuple of str
        Parameters that take consistent values of any size and both signs.
    model : TransferFunction
        The simpler structure.
    theta : (p - 1,) or (p,) float
        Its parameters.
    """

    names: tuple[str, ...]
    model: TransferFunction
    theta: NDArray[np.float64]

    def verify(self, formulation: Formulation) -> bool:
        """Whether the simpler structure is one of the two, and proved consistent."""
        for lower in _simpler(formulation):
            if lower.model == self.model and self.theta.shape == (len(lower.parameters),):
                named = _moved(formulation, self.model, self.theta)
                return self.names == named and consistent(lower, self.theta) is not None
        return False


def endless_by(formulation: Formulation, until: float = inf) -> Endless | None:
    """What proves that some parameters take consistent values of any size.

    Parameters
    ----------
    formulation : Formulation
    until : float
        Reading of ``time.monotonic`` at which the search ends; it takes no longer than five
        seconds for each simpler structure.

    Returns
    -------
    Endless or None
        None where nothing was proved. Only transfer functions of one input and one output
        with free initial conditions, without equation errors, missing samples, noise
        constraints or priors are looked at.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
    >>> model = setid.TransferFunction(na=1, nb=2)
    >>> endless_by(setid.formulate(data, model, setid.Noise(output=0.2))).names
    ('a1', 'b1')
    """
    for lower in _simpler(formulation):
        theta = _member(lower, min(until, time.monotonic() + _SECONDS))
        if theta is not None:
            assert isinstance(lower.model, TransferFunction)
            names = _moved(formulation, lower.model, theta)
            return Endless(names, lower.model, frozen(np.array(theta)))
    return None


def _moved(
    formulation: Formulation, model: TransferFunction, theta: NDArray[np.float64]
) -> tuple[str, ...]:
    """The parameters that change with c."""
    na = model.na[0][0]
    sooner = isinstance(formulation.model, TransferFunction) and model.nk != formulation.model.nk
    numerator = theta[na:] if sooner else np.append(0.0, theta[na:])
    slope = np.concatenate([[1.0], theta[:na], numerator])
    return tuple(n for n, c in zip(formulation.parameters, slope, strict=True) if c != 0.0)


def _simpler(formulation: Formulation) -> list[Formulation]:
    """The structures of the arguments above, with the data and noise that they are about."""
    model, data = formulation.model, formulation.data
    if not isinstance(model, TransferFunction) or (model.inputs, model.outputs) != (1, 1):
        return []
    na, nb, nk = model.na[0][0], model.nb[0][0], model.nk[0][0]
    plain = model.initial == "free" and not model.offset and na >= 1
    known = not (np.isnan(data.y).any() or np.isnan(data.u).any())
    output, input, equation = formulation.noise.bounds(data)
    free = not formulation.priors and not formulation.noise.constraints
    if not (plain and known and free) or np.any(equation > 0):
        return []
    found = []
    spare = bool(np.all(output > _INSIDE * output))  # not so if it is zero or nearly
    if nk >= 1 and spare and data.records == 1 and data.samples > na + 1:
        last = data.samples - 1
        inside = Noise(output=_INSIDE * output[:last], input=_INSIDE * input[:last])
        sooner = TransferFunction(na - 1, nb, nk - 1)
        found.append(formulate(data.split(last)[0], sooner, inside))
    if nb >= 2:
        found.append(formulate(data, TransferFunction(na - 1, nb - 1, nk), formulation.noise))
    return found


def _member(formulation: Formulation, until: float) -> NDArray[np.float64] | None:
    """A parameter vector that is proved consistent: an estimate, or what the engine finds."""
    p = len(formulation.parameters)
    for estimate in (linf, least_squares):
        try:
            theta = estimate(formulation.data, formulation.model).theta
        except ModelError:
            continue
        if consistent(formulation, theta) is not None:
            return theta
    noise = scaled_noise(formulation.noise.bounds(formulation.data), _WIDE)
    wide = formulate(formulation.data, formulation.model, noise)
    found = nearby(wide, first_point(wide, wide.problem), until)
    if found is None or consistent(formulation, found.x[:p]) is None:
        return None
    return found.x[:p]
