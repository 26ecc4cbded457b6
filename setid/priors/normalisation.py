"""Static gain 1 of linear blocks: what makes the parameters of a block structure unique."""

from __future__ import annotations

from dataclasses import dataclass

import sparsepop_py as sp
from setid.models.block import BlockStructured
from setid.models.equations import Structure
from setid.priors.base import Facts, Plain, Symbols, named

__all__ = ["UnitGain"]


@dataclass(frozen=True, slots=True)
class UnitGain(Plain):
    """sum b == 1 + sum a for each named linear block; :func:`formulate` adds it by itself.

    Parameters
    ----------
    labels : tuple of str
        Of :attr:`BlockStructured.linear_blocks`.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3, 2], [0, 1, 1, 2])
    >>> model = setid.Hammerstein(setid.TransferFunction(1, 2, 0), 2, normalise="dcgain")
    >>> problem = setid.formulate(data, model, setid.Noise(0.1)).problem
    >>> print(problem.constraints[-1])
    static gain of y1,w: -1 - a1 + b0 + b1 == 0
    """

    labels: tuple[str, ...]

    def describe(self) -> str:
        """Describe it in words: it is a choice of representatives."""
        return f"normalisation: static gain of {', '.join(self.labels)} is 1"

    def rows(self, model: Structure, x: Symbols, facts: Facts) -> list[sp.Constraint]:
        """State one equation a block."""
        rows = []
        assert isinstance(model, BlockStructured)
        for label in self.labels:
            block = model.linear_blocks[label]
            top, below = ([x[n] for n in names] for names in (block.numerator, block.denominator))
            row = sp.total([*top, *(-1.0 * a for a in below), *([-1.0 + top[0] * 0.0])]) == 0
            rows += named([row], f"static gain of {label}")
        return rows
