"""Proofs that parameters are unbounded: a simpler structure explains the data as well.

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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.data.noise import Noise
from setid.formulation.formulation import Formulation, formulate
from setid.models.lti import TransferFunction
from setid.proofs.existence import proved_point
from setid.proofs.fields import well_formed

__all__ = ["Unbounded", "moved_parameters", "simpler_structures"]

_INSIDE = 1.0 - 2.0**-16  # of the noise bounds: strictly inside, by however little


@dataclass(frozen=True, slots=True, eq=False)
class Unbounded:
    """A simpler structure that explains the data, and the parameters that it makes unbounded.

    Parameters
    ----------
    names : tuple of str
        Parameters that take consistent values of any size and both signs.
    model : TransferFunction
        The simpler structure.
    theta : (p - 1,) or (p,) float
        Its parameters.
    witness : (m,) float
        All unknowns of its formulation, noise included, near which consistent ones exist.
    """

    names: tuple[str, ...]
    model: TransferFunction
    theta: NDArray[np.float64]
    witness: NDArray[np.float64]

    def verify(self, formulation: Formulation) -> bool:
        """Check that the simpler structure is one of the two, and consistent, without a solver.

        Parameters
        ----------
        formulation : Formulation
        """
        if not well_formed(self):
            return False
        for lower in simpler_structures(formulation):
            p = len(lower.parameters)
            shapes = self.theta.shape == (p,) and self.witness.shape == (lower.problem.dimension,)
            if lower.model == self.model and shapes:
                named = moved_parameters(formulation, self.model, self.theta)
                point = proved_point(lower, lower.problem, self.witness)
                held = point is not None and np.array_equal(point.x[:p], self.theta)
                return self.names == named and held
        return False


def moved_parameters(
    formulation: Formulation, model: TransferFunction, theta: NDArray[np.float64]
) -> tuple[str, ...]:
    """Name the parameters that change with c."""
    na = model.na[0][0]
    sooner = isinstance(formulation.model, TransferFunction) and model.nk != formulation.model.nk
    numerator = theta[na:] if sooner else np.append(0.0, theta[na:])
    slope = np.concatenate([[1.0], theta[:na], numerator])
    return tuple(n for n, c in zip(formulation.parameters, slope, strict=True) if c != 0.0)


def simpler_structures(formulation: Formulation) -> list[Formulation]:
    """List the structures of the arguments above, with the data and noise that they are about."""
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
