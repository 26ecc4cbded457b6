"""Coefficients of maps that quotients leave without bounds: certificates that none is far away.

Rows bound products b gamma, and gamma = (b gamma) / b only where b excludes zero. With
gamma_i = phi_i / s, |s| <= 1 / R, max |phi_i| = 1 and c = b / s,

    b gamma_i = c phi_i,    b = s c,

so that on each face phi_i = 1 of a cube all unknowns are bounded: c by the rows, as b gamma_i.
Where it is certified that no face holds a consistent point, all |gamma_i| < R.
:mod:`sparsepop_py.uncertain_rows.unbounded_coefficients` searches for the certificates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Polynomial, variables
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.products import ProductRows, Total, contracted

__all__ = ["CoefficientLimit", "Faces"]

Reals = NDArray[np.float64]

_ROWS = 50  # of the record: the first ones say enough of what is far away


class CoefficientLimit(NamedTuple):
    """Proofs that parameters are smaller than ``reach`` in size, one for each of them."""

    parameters: tuple[int, ...]
    reach: float
    proofs: tuple[Certificate | None, ...]  # None where bounds of products are enough

    def within(self, box: Reals) -> Reals:
        """Intersect the box (2, p) with these bounds."""
        found, chosen = box.copy(), list(self.parameters)
        found[0, chosen] = np.maximum(found[0, chosen], -self.reach)
        found[1, chosen] = np.minimum(found[1, chosen], self.reach)
        return found

    def follows(self, coupled: CoupledRows, rows: ProductRows, ends: Reals, box: Reals) -> bool:
        """Check the proofs, given what the search was given."""
        faces = Faces.of(coupled, rows, ends, box)
        if faces is None or faces.far != self.parameters or len(self.proofs) != len(faces.far):
            return False
        if any(type(i) is not int for i in self.parameters):
            return False
        if type(self.reach) is not float or not 0 < self.reach < np.inf:
            return False
        return all(
            faces.holds(face, self.reach, proof)
            for face, proof in zip(faces.far, self.proofs, strict=True)
        )


@dataclass(frozen=True, eq=False)
class Faces:
    """Data that the problems of all faces share."""

    coupled: CoupledRows
    rows: ProductRows
    ends: Reals
    box: Reals
    far: tuple[int, ...]  # the parameters without bounds
    partners: frozenset[int]  # what they are multiplied by

    @staticmethod
    def of(coupled: CoupledRows, rows: ProductRows, ends: Reals, box: Reals) -> Faces | None:
        """Find the partners; None where an unbounded parameter also meets others."""
        far = tuple(np.flatnonzero(np.any(np.isinf(box), axis=0)).tolist())
        pairs = [m for column in rows.columns for m in column if len(m) == 2]
        partners = frozenset(
            i for m in pairs for i, other in (m, m[::-1]) if other in far and i not in far
        )
        found = Faces(coupled, rows, ends, box, far, partners)
        return found if far and partners and all(map(found._expressible, found._samples)) else None

    @cached_property
    def _samples(self) -> list[Constraint]:
        """The first rows of the record."""
        return self.coupled.constraints[:_ROWS]

    @cached_property
    def constraints(self) -> dict[int, list[Constraint]]:
        """For each face its constraints; priors that its unknowns cannot express are left out."""
        kept = [row for row in (*self._samples, *self.coupled.others) if self._expressible(row)]
        return {face: [self._row(row, face) for row in kept] for face in self.far}

    def _expressible(self, row: Constraint) -> bool:
        """Check that the unknowns of a face can express a constraint."""
        return all(map(self._suits, row.polynomial.words.tolist()))

    def _suits(self, word: Sequence[int]) -> bool:
        """Check for at most one partner, needed by an unbounded parameter."""
        far = sum(letter - 1 in self.far for letter in word)
        return far <= sum(letter - 1 in self.partners for letter in word) <= 1

    def _mapped(self, factors: Sequence[int], face: int) -> list[int]:
        """Rewrite a product in the unknowns of a face.

        c stands for b, s for gamma_face.
        """
        if face in factors:
            return sorted(v for v in factors if v != face)
        if any(v in self.far for v in factors):
            return sorted(factors)  # c phi
        held = [face] if any(v in self.partners for v in factors) else []
        return sorted([*factors, *held])

    @property
    def unit(self) -> float:
        """A power of two, of the size of a product by that of its partner."""
        size = np.abs(self.ends).max(axis=0)
        columns = {column[0]: size[k] for k, column in enumerate(self.rows.columns)}
        top = max(
            (v for m, v in columns.items() if len(m) == 2 and set(m) & set(self.far)), default=1
        )
        below = max((columns.get((i,), 0.0) for i in self.partners), default=0.0)
        if not 0 < top < np.inf or not 0 < below < np.inf:
            return 1.0
        return float(np.exp2(np.clip(np.round(np.log2(top / below)), -60, 60)))

    def holds(self, face: int, reach: float, proof: Certificate | None) -> bool:
        """Check the proof that a face holds no consistent point."""
        box = self.unknowns(face, reach)
        if np.any(box[0] > box[1]):
            return True
        if not isinstance(proof, Certificate) or not np.all(np.isfinite(box)):
            return False
        return proof.bound == np.inf and proof.verify(self.problem(face, box)).ok

    def unknowns(self, face: int, reach: float) -> Reals:
        """Bound the unknowns of a face where |s| <= 1 / reach, shape (2, n)."""
        known, p = self.coupled.problem, self.box.shape[1]
        start, inverse = self.box.copy(), float(np.nextafter(1.0 / reach, np.inf))
        start[:, list(self.far)] = [[-1.0], [1.0]]
        start[:, list(self.partners)] = [[-np.inf], [np.inf]]
        start[:, face] = -inverse, inverse
        totals: dict[Total, tuple[float, float]] = {}
        for column, low, high in zip(self.rows.columns, *self.ends.tolist(), strict=True):
            if all(self._suits([v + 1 for v in m]) for m in column):
                totals[tuple(tuple(self._mapped(m, face)) for m in column)] = (low, high)
        box = contracted(start, totals, ())
        return np.concatenate([box, [known.lower[p:], known.upper[p:]]], axis=1)

    def problem(self, face: int, box: Reals) -> Problem:
        """State the consistent points of a face."""
        names = self.coupled.problem.names
        nothing = 0.0 * variables(len(names))[0]
        return Problem(nothing, self.constraints[face], box[0], box[1], names)

    def _row(self, row: Constraint, face: int) -> Constraint:
        """A constraint in the unknowns of a face."""
        words = row.polynomial.words.tolist()
        mapped = [self._mapped([v - 1 for v in word if v], face) for word in words]
        wide = np.zeros((len(words), max(map(len, mapped), default=0) or 1), np.int32)
        for place, word in enumerate(mapped):
            wide[place, wide.shape[1] - len(word) :] = [v + 1 for v in word]
        n, names = self.coupled.problem.dimension, self.coupled.problem.names
        made = Polynomial.from_words(wide, row.polynomial.coefficients, n, names)
        return Constraint(made, row.kind)
