"""Parameters that may take any value without a change in any equation.

A parameter that occurs in no row is one. So is a coefficient whose signals may all be zero:
where the noise bounds cover a whole record, noise alone explains it, and nothing is learnt of a
denominator that multiplies zeros, nor of a numerator where the inputs may be zero as well.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.formulation.formulation import Formulation

__all__ = ["free_parameters"]


def free_parameters(
    formulation: Formulation,
) -> tuple[tuple[str, ...], NDArray[np.float64] | None]:
    """Find parameters proved to be free, where noise alone explains the record.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    names : tuple of str
        Each of them may take any value, the others at those of the witness; empty where
        nothing was proved.
    witness : (n,) float or None
        A consistent vector of all unknowns, parameters zero, for which this holds in rationals.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, -1, 2], [0.1, 0.0, -0.1, 0.1])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> free_parameters(setid.formulate(data, model, setid.Noise(output=0.2)))[0]
    ('a1',)
    """
    problem, best, witness = formulation.problem, list[int](), None
    ends = np.array([problem.lower, problem.upper])
    for quiet in product((False, True), repeat=2):
        x = _noise_alone(formulation, *quiet)
        if np.any(x < ends[0]) or np.any(x > ends[1]):
            continue
        free = _free(problem, x, len(formulation.parameters))
        if len(free) > len(best):
            best, witness = free, x
    return tuple(formulation.parameters[i] for i in best), witness


def _noise_alone(formulation: Formulation, outputs: bool, inputs: bool) -> NDArray[np.float64]:
    """Make a vector whose noise equals the readings, so that true signals are zero."""
    x = np.zeros(formulation.problem.dimension)
    data = formulation.data
    for wanted, group, signal in ((outputs, "eta", data.y), (inputs, "xi", data.u)):
        numbers = formulation.layout.group(group)
        if wanted:
            x[numbers[numbers >= 0]] = signal[numbers >= 0]
    return x


def _free(problem: sp.Problem, x: NDArray[np.float64], count: int) -> list[int]:
    """Find unknowns that change no row at x, whatever their value; none if x fails."""
    free = {i for i in range(count) if problem.lower[i] == -np.inf and problem.upper[i] == np.inf}
    for row, equal in zip(problem.constraints, problem.equality, strict=True):
        powers: dict[tuple[int, int], Fraction] = {}
        words, coefficients = row.polynomial.words, row.polynomial.coefficients
        for word, coefficient in zip(words.tolist(), coefficients.tolist(), strict=True):
            letters = [letter - 1 for letter in word if letter]
            for i in {-1, *(letter for letter in letters if letter in free)}:
                rest = [Fraction(float(x[v])) for v in letters if v != i]
                key = (i, len(letters) - len(rest))
                value = Fraction(coefficient)
                for factor in rest:
                    value *= factor
                powers[key] = powers.get(key, Fraction(0)) + value
        level = powers.get((-1, 0), Fraction(0))
        if level < 0 or (equal and level != 0):
            return []
        free -= {i for (i, power), value in powers.items() if i >= 0 and power and value}
        if not free:
            return []
    return sorted(free)
