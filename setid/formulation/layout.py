"""Places of all unknowns of a record in the vector of variables of its problem.

The order is theta, output noise, input noise, equation errors, missing outputs, missing
inputs, internal signals, unknowns of priors, sums of products of parameters. Samples are counted
from 1 in names, as in the literature: ``eta[7]``; ``eta[2,7]`` is sample 7 of record 2,
``eta2[7]`` belongs to output 2. Counts and numbers that are always 1 are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, frozen, natural
from setid.data.record import IOData
from setid.errors import SetidError
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Layout", "LayoutBuilder"]


@dataclass(frozen=True, slots=True, eq=False)
class Layout(ReadOnly):
    """Names and numbers of all variables.

    Parameters
    ----------
    names : tuple of str
        One a variable.
    groups : mapping of str to int arrays
        Variable numbers from 0, -1 where a sample has no variable: ``theta`` (p,),
        ``eta`` (N, ny), ``xi`` (N, nu), ``e`` (N, ny), ``y`` (N, ny) and ``u`` (N, nu)
        missing samples, one (N,) for each internal signal, ``slack`` for the unknowns of
        priors, ``lifted`` for sums of products of parameters. Groups without variables are
        there too.
    starts : (records,) int
        Rows at which records begin.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 2, 3], [2, 3, 4])
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> layout = setid.formulate(data, model, setid.Noise(output=0.1)).layout
    >>> layout.names
    ('a1', 'b1', 'eta[1]', 'eta[2]', 'eta[3]')
    >>> layout.group("eta").ravel(), layout.index("eta[2]")
    (array([2, 3, 4]), 3)
    """

    names: tuple[str, ...]
    groups: Mapping[str, NDArray[np.int64]]
    starts: NDArray[np.int64]
    _places: Mapping[str, int] = field(repr=False)

    @property
    def dimension(self) -> int:
        """Number of variables n."""
        return len(self.names)

    def index(self, name: str) -> int:
        """Find the number of a variable by name.

        Parameters
        ----------
        name : str

        Raises
        ------
        SetidError
            If there is none; exact samples have no variable.
        """
        if not isinstance(name, str) or name not in self._places:
            raise SetidError(
                f"name: found {name!r}, expected one of {', '.join(self.names[:8])}, ... "
                "(exact and missing samples have no noise variable)"
            )
        return self._places[name]

    def group(self, name: str) -> NDArray[np.int64]:
        """List variable numbers of a group.

        Parameters
        ----------
        name : str
            One of the keys of ``groups``.
        """
        if not isinstance(name, str) or name not in self.groups:
            raise SetidError(f"group: found {name!r}, expected one of {', '.join(self.groups)}")
        return self.groups[name]

    def variable(self, name: str) -> sp.Polynomial:
        """Write a variable by name, as a polynomial in all variables.

        Parameters
        ----------
        name : str
        """
        return self.polynomial(self.index(name))

    def polynomial(self, number: int) -> sp.Polynomial:
        """Write a variable by number, as a polynomial in all variables.

        Parameters
        ----------
        number : int
            From 0.
        """
        place = natural(number, "number", SetidError, most=self.dimension - 1)
        word = np.array([[place + 1]], np.int32)
        return sp.Polynomial(frozen(word), frozen(np.ones(1)), self.dimension, self.names)

    def lift(self, polynomial: sp.Polynomial, numbers: NDArray[np.int64]) -> sp.Polynomial:
        """Lift a polynomial in few variables to all, variable i becoming ``numbers[i]``.

        Parameters
        ----------
        polynomial : Polynomial
        numbers : (k,) int
            Numbers of its variables here, from 0.
        """
        letters = np.append(0, numbers + 1).astype(np.int32)[polynomial.words]
        letters.sort(axis=1)
        return sp.Polynomial.from_words(
            letters, polynomial.coefficients, self.dimension, self.names
        )


class LayoutBuilder:
    """Gives out variable numbers, group by group.

    Parameters
    ----------
    data : IOData
        For the numbering of samples.
    """

    def __init__(self, data: IOData) -> None:
        self._names: list[str] = []
        self._groups: dict[str, NDArray[np.int64]] = {}
        self._starts = data.starts
        sample = np.arange(data.samples) - data.first + 1
        if data.records == 1:
            self._labels = [f"[{k}]" for k in sample.tolist()]
        else:
            pairs = zip(data.record.tolist(), sample.tolist(), strict=True)
            self._labels = [f"[{r + 1},{k}]" for r, k in pairs]

    def named(self, group: str, names: Sequence[str]) -> None:
        """Add one variable for each name."""
        first = len(self._names)
        self._names.extend(names)
        self._groups[group] = frozen(np.arange(first, first + len(names)))

    def samples(self, group: str, present: NDArray[np.bool_]) -> None:
        """Add one variable for each sample that is present, shape (N,) or (N, channels)."""
        numbers = np.full(present.shape, -1)
        columns = present.reshape(len(present), -1)
        flat = numbers.reshape(columns.shape)
        for channel in range(columns.shape[1]):
            label = group if columns.shape[1] == 1 else f"{group}{channel + 1}"
            rows = np.flatnonzero(columns[:, channel])
            flat[rows, channel] = len(self._names) + np.arange(rows.size)
            self._names.extend(label + self._labels[row] for row in rows.tolist())
        self._groups[group] = frozen(numbers)

    def finish(self) -> Layout:
        """Make the layout, with all names distinct."""
        places = {name: number for number, name in enumerate(self._names)}
        if len(places) != len(self._names):
            twice = sorted({name for name in self._names if self._names.count(name) > 1})
            raise SetidError(f"priors: found two that ask for {twice[0]}; is one given twice?")
        return Layout(tuple(self._names), FrozenMapping(self._groups), self._starts, places)
