"""Linear time-invariant structures: one or many inputs and outputs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import MOST_TERMS, channel_pair, natural, switch, word
from setid.errors import ModelError
from setid.models.equations import Equation, Initial, Lagged, Term, Transfer, term
from setid.models.html import InNotebook

__all__ = ["Form", "TransferFunction", "expand"]

Form = Literal["auto", "direct", "partial", "multiplied", "lifted", "driven"]
_ELIMINATED = ("multiplied", "lifted")  # forms whose offset is added to the output itself
Orders = tuple[tuple[int, ...], ...]  # one row an output, one column an input


@dataclass(frozen=True, slots=True, init=False, repr=False)
class TransferFunction(InNotebook):
    """y(k) = - sum_i a_i y(k-i) + sum_j b_j u(k-j), j = nk, ..., nk + nb - 1.

    Coefficients are named by their lag: ``a1``, ``b0``; with nk = 1 the first one is
    ``b1``. With several inputs or outputs they are ``b[output,input]lag``, and
    ``a[output,input]lag`` unless the denominator is common. na = 0 gives a finite impulse
    response, na = 0 with nb = 1 a static gain.

    Parameters
    ----------
    na, nb : int or array_like (outputs, inputs) of int
        Numbers of denominator and numerator coefficients.
    nk : int or array_like (outputs, inputs) of int
        Delay in samples: the lag of the first numerator coefficient.
    inputs, outputs : int
    common_denominator : bool
        One denominator for all pairs of channels; otherwise each has its own.
    offset : bool
        An unknown constant in each output's equation: ``c``, or ``c[output]``. It stands
        for constant errors of the sensors: one of d in y and f in u makes
        c = (1 + sum a) d - (sum b) f. Beside partial outputs, and in the forms
        ``"multiplied"`` and ``"lifted"``, it is added to the output itself. With
        ``initial="zero"`` it acts from the first sample on.
    initial : {"free", "zero"}
        ``"free"``: rows start where all lags lie within the record, and the samples before
        are unknown. ``"zero"``: all signals are zero before the record, and every sample
        has a row.
    form : {"auto", "direct", "partial", "multiplied", "lifted", "driven"}
        How several denominators meet in one output. ``"partial"``: the partial output
        z[i,j] of each pair is an unknown signal, rows are bilinear. ``"direct"``:
        denominators are multiplied out, degree p + 1 for p inputs. ``"auto"``: direct
        where rows stay bilinear, else partial. ``"multiplied"``: the rows that partial outputs
        leave when they are eliminated, those of ``"direct"`` with c (1 + sum a) of each
        denominator for c. ``"lifted"``: the same rows with sums of products of coefficients as
        unknowns of their own, so that they are bilinear. ``"driven"``: the same unknowns in the
        rows of ``"direct"``, whose c drives the equation.

    Raises
    ------
    ModelError
        If an order is negative or shapes do not fit, or partial outputs with an offset that begin
        at zero are to be eliminated.

    References
    ----------
    L. Ljung, System Identification, 2nd ed. 1999, section 4.2 (names and orders).
    V. Cerone, D. Piga, D. Regruto, "Set-membership error-in-variables identification
    through convex relaxation techniques", IEEE Trans. Automatic Control 57 (2012) 517-522.

    Examples
    --------
    >>> import setid
    >>> setid.TransferFunction(na=2, nb=2, nk=1).parameters
    ('a1', 'a2', 'b1', 'b2')
    >>> setid.TransferFunction(1, 1, nk=1, inputs=2).parameters
    ('a[1,1]1', 'a[1,2]1', 'b[1,1]1', 'b[1,2]1')
    """

    na: Orders
    nb: Orders
    nk: Orders
    inputs: int
    outputs: int
    common_denominator: bool
    offset: bool
    initial: Initial
    form: Form

    def __init__(
        self,
        na: int | Sequence[Sequence[int]] | NDArray[np.int64],
        nb: int | Sequence[Sequence[int]] | NDArray[np.int64],
        nk: int | Sequence[Sequence[int]] | NDArray[np.int64] = 0,
        inputs: int = 1,
        outputs: int = 1,
        common_denominator: bool = False,
        offset: bool = False,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        columns = natural(inputs, "inputs", ModelError, least=1, most=MOST_TERMS)
        rows = natural(outputs, "outputs", ModelError, least=1, most=MOST_TERMS)
        if rows * columns > MOST_TERMS:
            raise ModelError(
                f"inputs, outputs: found {columns * rows} pairs, expected at most {MOST_TERMS}"
            )
        word(initial, "initial", ("free", "zero"), ModelError)
        word(form, "form", get_args(Form), ModelError)
        fields: dict[str, Any] = {
            "na": _orders(na, "na", rows, columns),
            "nb": _orders(nb, "nb", rows, columns, least=1),
            "nk": _orders(nk, "nk", rows, columns),
            "inputs": columns,
            "outputs": rows,
            "common_denominator": switch(common_denominator, "common_denominator", ModelError),
            "offset": switch(offset, "offset", ModelError),
            "initial": initial,
            "form": form,
        }
        if common_denominator and len({n for row in fields["na"] for n in row}) > 1:
            raise ModelError("na: found several orders, expected one for a common denominator")
        if form in _ELIMINATED and initial == "zero" and fields["offset"]:
            raise ModelError(
                f"initial: found 'zero', expected 'free' beside form={form!r} and an offset"
            )
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    def __repr__(self) -> str:
        """As it was made, without what was left at its default."""
        given = {name: _brief(getattr(self, name)) for name in ("na", "nb", "nk")}
        usual: dict[str, Any] = {
            "nk": 0,
            "inputs": 1,
            "outputs": 1,
            "common_denominator": False,
            "offset": False,
        }
        usual |= {"initial": "free", "form": "auto"}
        given |= {name: getattr(self, name) for name in usual if name != "nk"}
        kept = [f"{k}={v!r}" for k, v in given.items() if k not in usual or v != usual[k]]
        return f"TransferFunction({', '.join(kept)})"

    # ---- names --------------------------------------------------------------------------

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters: denominators, numerators, offsets."""
        pairs = list(product(range(self.outputs), range(self.inputs)))
        a = [name for i, j in pairs for name in self._denominator(i, j)]
        b = [name for i, j in pairs for name in self._numerator(i, j)]
        return tuple(dict.fromkeys([*a, *b, *self.offsets()]))

    def transfer(self, output: int = 1, input: int = 1) -> Transfer:
        """Name coefficients of the transfer function between two channels (from 1).

        Parameters
        ----------
        output, input : int
            Channels, from 1.
        """
        output, input = channel_pair(output, input, self.outputs, self.inputs)
        i, j = output - 1, input - 1
        return Transfer(self._numerator(i, j), self._denominator(i, j), self.nk[i][j])

    def _pair(self, i: int, j: int) -> str:
        return f"[{i + 1},{j + 1}]" if self.inputs * self.outputs > 1 else ""

    def _denominator(self, i: int, j: int) -> tuple[str, ...]:
        pair = "" if self.common_denominator else self._pair(i, j)
        return tuple(f"a{pair}{lag}" for lag in range(1, self.na[i][j] + 1))

    def _numerator(self, i: int, j: int) -> tuple[str, ...]:
        first = self.nk[i][j]
        return tuple(f"b{self._pair(i, j)}{lag}" for lag in range(first, first + self.nb[i][j]))

    def offsets(self) -> tuple[str, ...]:
        """Names of the constants, one an output; none without an offset."""
        return tuple(self._offset(i) for i in range(self.outputs)) if self.offset else ()

    def _offset(self, i: int) -> str:
        return "c" if self.outputs == 1 else f"c[{i + 1}]"

    # ---- equations ----------------------------------------------------------------------

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State difference equations; noise does not change their form.

        Parameters
        ----------
        noisy : collection of str
            Not used here.
        """
        return tuple(
            equation
            for i in range(self.outputs)
            for equation in (self._partial(i) if self._splits(i) else [self._multiplied(i)])
        )

    def regression(self) -> tuple[Equation, ...]:
        """State equations linear in theta: for one denominator an output, else none."""
        direct = self.multiplied()
        return direct if all(equation.linear_in_parameters for equation in direct) else ()

    def multiplied(self) -> tuple[Equation, ...]:
        """State an equation for each output, in outputs and inputs alone."""
        return tuple(self._multiplied(i) for i in range(self.outputs))

    def denominators(self, i: int) -> list[tuple[str, ...]]:
        """List the distinct denominators of an output, without trivial ones.

        Parameters
        ----------
        i : int
            The output, from 0.
        """
        return [d for d in dict.fromkeys(self._denominator(i, j) for j in range(self.inputs)) if d]

    def _splits(self, i: int) -> bool:
        several = len(self.denominators(i)) > 1 or (
            bool(self.denominators(i)) and () in [self._denominator(i, j) for j in self._js]
        )
        return self.form == "partial" or (self.form == "auto" and several)

    @property
    def _js(self) -> range:
        return range(self.inputs)

    def _multiplied(self, i: int) -> Equation:
        """D_1 ... D_p y - sum_j N_j (the other denominators) u_j - c == 0.

        Where c is added to the output itself, (1 + sum a) of each denominator multiplies it.
        """
        denominators = self.denominators(i)
        left = [_times_signal(t, f"y{i + 1}", 1.0) for t in expand(denominators)]
        right = []
        for j in self._js:
            own = self._denominator(i, j)
            others = expand([d for d in denominators if d != own])
            for shift, name in enumerate(self._numerator(i, j), self.nk[i][j]):
                right += [
                    _times_signal((lag + shift, (*names, name)), f"u{j + 1}", -1.0)
                    for lag, names in others
                ]
        added = denominators if self._splits(i) or self.form in _ELIMINATED else []
        offset = [self._offset(i)] if self.offset else []
        constant = [Term(-1.0, (*names, c), ()) for c in offset for _, names in expand(added)]
        return Equation(f"y{i + 1}", (*left, *right, *constant), error=True)

    def _partial(self, i: int) -> list[Equation]:
        """z_j + sum_i a_i z_j(k-i) - sum b u_j == 0 for each input, then y == sum z_j + c."""
        equations, total = [], [term(1.0, "", Lagged(f"y{i + 1}"))]
        for j in self._js:
            z = f"z[{i + 1},{j + 1}]"
            terms = [term(1.0, "", Lagged(z))]
            terms += [term(1.0, a, Lagged(z, n)) for n, a in enumerate(self._denominator(i, j), 1)]
            terms += [
                term(-1.0, b, Lagged(f"u{j + 1}", lag))
                for lag, b in enumerate(self._numerator(i, j), self.nk[i][j])
            ]
            equations.append(Equation(z, tuple(terms)))
            total.append(term(-1.0, "", Lagged(z)))
        if self.offset:
            total.append(term(-1.0, self._offset(i)))
        return [*equations, Equation(f"y{i + 1}", tuple(total))]


def _brief(orders: Orders) -> int | Orders:
    """One number where all pairs of channels have the same order."""
    found = {n for row in orders for n in row}
    return found.pop() if len(found) == 1 else orders


def _orders(given: object, field: str, outputs: int, inputs: int, least: int = 0) -> Orders:
    table = np.array(given, dtype=object)
    if table.ndim not in (0, 2) or (table.ndim == 2 and table.shape != (outputs, inputs)):
        raise ModelError(
            f"{field}: found shape {table.shape}, expected an integer or ({outputs}, {inputs}) for "
            f"outputs={outputs} and inputs={inputs}"
        )
    full = np.broadcast_to(table, (outputs, inputs)).tolist()
    return tuple(
        tuple(natural(v, field, ModelError, least, most=MOST_TERMS) for v in row) for row in full
    )


def expand(denominators: list[tuple[str, ...]]) -> list[tuple[int, tuple[str, ...]]]:
    """Multiply polynomials 1 + sum a_i q^-i to (lag, parameter names) pairs."""
    terms: list[tuple[int, tuple[str, ...]]] = [(0, ())]
    for names in denominators:
        factors = [(0, ()), *((lag, (name,)) for lag, name in enumerate(names, 1))]
        terms = [(p + q, (*left, *right)) for p, left in terms for q, right in factors]
    return terms


def _times_signal(term: tuple[int, tuple[str, ...]], signal: str, sign: float) -> Term:
    lag, names = term
    return Term(sign, names, (Lagged(signal, lag),))
