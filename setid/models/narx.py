"""Polynomial regression models: y(k) is a polynomial of past outputs and inputs."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from math import comb
from typing import Any

import numpy as np

from setid.data.checks import MOST_TERMS, entries_of, natural, switch, word
from setid.errors import ModelError
from setid.models.equations import Equation, Initial, Lagged, Transfer, term
from setid.models.html import InNotebook
from setid.models.products import cut_products

__all__ = ["PolynomialNARX"]

Monomial = tuple[Lagged, ...]  # sorted, repeated as often as the power says
_FACTOR = re.compile(r"([yu])(?:\[(\d+)\])?(\d+)(?:(?:\^|\*\*)(\d+))?")


@dataclass(frozen=True, slots=True, init=False)
class PolynomialNARX(InNotebook):
    """y(k) = sum_t c_t m_t(k), with monomials m_t in y(k-1..k-ny) and u(k..k-nu).

    Parameters
    ----------
    terms : sequence of str, or (T, R) array_like of int
        Monomials as text, such as ``"1"``, ``"y1"``, ``"u0^2"``, ``"y1*u1"`` for
        y(k-1) u(k-1), with ``y[2]1`` for channel 2; or exponents of the R regressors in the
        order of :attr:`regressors`. Several outputs: one such sequence each.
    ny, nu : int
        Largest lags of outputs and inputs.
    inputs, outputs : int
    initial : {"free", "zero"}
        As for :class:`TransferFunction`.
    degree_cut : bool
        Rows in which a parameter meets a product of several noisy samples get the products
        as unknown signals, so that all rows are bilinear and the lowest order of relaxation
        is 1. Their ranges follow from the data.

    Raises
    ------
    ModelError
        Naming the term that cannot be read, is repeated, or exceeds the lags.

    Notes
    -----
    Parameters are named after their monomials: ``c[y1*u1]``, and ``c2[y1*u1]`` for
    output 2 of several.

    References
    ----------
    S. A. Billings, Nonlinear System Identification, Wiley 2013, section 2.2.

    Examples
    --------
    >>> import setid
    >>> model = setid.PolynomialNARX(["y1", "u0", "u1^2", "y1*u0"], ny=1, nu=1)
    >>> model.parameters
    ('c[y1]', 'c[u0]', 'c[u1^2]', 'c[y1*u0]')
    >>> setid.PolynomialNARX.full(degree=2, ny=1, nu=0).parameters
    ('c[1]', 'c[y1]', 'c[u0]', 'c[y1^2]', 'c[y1*u0]', 'c[u0^2]')
    """

    terms: tuple[tuple[str, ...], ...]
    ny: int
    nu: int
    inputs: int
    outputs: int
    initial: Initial
    degree_cut: bool
    _monomials: tuple[tuple[Monomial, ...], ...] = field(repr=False)

    def __init__(
        self,
        terms: Sequence[Any],
        ny: int,
        nu: int,
        inputs: int = 1,
        outputs: int = 1,
        initial: Initial = "free",
        degree_cut: bool = True,
    ) -> None:
        word(initial, "initial", ("free", "zero"), ModelError)
        fields: dict[str, Any] = {
            "ny": natural(ny, "ny", ModelError, most=MOST_TERMS),
            "nu": natural(nu, "nu", ModelError, most=MOST_TERMS),
            "inputs": natural(inputs, "inputs", ModelError, least=1, most=MOST_TERMS),
            "outputs": natural(outputs, "outputs", ModelError, least=1, most=MOST_TERMS),
            "initial": initial,
            "degree_cut": switch(degree_cut, "degree_cut", ModelError),
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)
        if isinstance(terms, str):
            raise ModelError(f"terms: found the text {terms!r}, expected a list of terms")
        entries: list[Any] = list(entries_of(terms, "terms", "a list of terms", ModelError))
        lists = [entries] if outputs == 1 else entries
        if len(lists) != outputs:
            raise ModelError(f"terms: found {len(lists)} lists, expected {outputs}, one an output")
        read = tuple(self._read_all(items) for items in lists)
        object.__setattr__(self, "_monomials", read)
        object.__setattr__(
            self, "terms", tuple(tuple(self._text(m) for m in items) for items in read)
        )

    @classmethod
    def full(
        cls,
        degree: int,
        ny: int,
        nu: int,
        inputs: int = 1,
        outputs: int = 1,
        constant: bool = True,
        initial: Initial = "free",
        degree_cut: bool = True,
    ) -> PolynomialNARX:
        """Take all monomials up to a degree.

        Parameters
        ----------
        degree : int
            At least 1.
        ny, nu, inputs, outputs, initial, degree_cut
            As for the class.
        constant : bool
            Whether the constant monomial belongs to them.
        """
        top = natural(degree, "degree", ModelError, least=1, most=MOST_TERMS)
        bare = cls(["1"], ny, nu, inputs, 1, initial, degree_cut)
        shell = _regressors(
            bare.ny, bare.nu, bare.inputs, natural(outputs, "outputs", ModelError, most=MOST_TERMS)
        )
        if comb(len(shell) + top, top) > MOST_TERMS:
            raise ModelError(
                f"degree: found {top} of {len(shell)} regressors, more than {MOST_TERMS} "
                "monomials, expected fewer"
            )
        texts = ["1"] if switch(constant, "constant", ModelError) else []
        single = inputs == outputs == 1
        for size in range(1, top + 1):
            for choice in combinations_with_replacement(shell, size):
                texts.append("*".join(_regressor_text(r, single) for r in choice))
        lists = texts if outputs == 1 else [texts] * outputs
        return cls(lists, ny, nu, inputs, outputs, initial, degree_cut)

    # ---- reading terms ------------------------------------------------------------------

    @property
    def regressors(self) -> tuple[str, ...]:
        """Regressors that rows of exponents refer to: outputs by lag, then inputs by lag."""
        single = self.inputs == self.outputs == 1
        found = _regressors(self.ny, self.nu, self.inputs, self.outputs)
        return tuple(_regressor_text(r, single) for r in found)

    def _read_all(self, items: Sequence[Any]) -> tuple[Monomial, ...]:
        found: list[Monomial] = []
        for place, item in enumerate(items):
            monomial = self._from_text(item, place) if isinstance(item, str) else None
            monomial = self._from_exponents(item, place) if monomial is None else monomial
            if monomial in found:
                raise ModelError(f"terms[{place}]: found {item!r} again, expected distinct terms")
            found.append(monomial)
        if not found:
            raise ModelError("terms: found none, expected at least one")
        return tuple(found)

    def _from_text(self, text: str, place: int) -> Monomial:
        factors: list[Lagged] = []
        for piece in text.replace(" ", "").replace("**", "^").split("*"):
            if piece == "1":
                continue
            match = _FACTOR.fullmatch(piece)
            if match is None:
                raise ModelError(
                    f"terms[{place}]: found {text!r}, expected factors such as y1, u0^2 or "
                    "y[2]1 joined by *"
                )
            kind, channel, lag, power = match.groups()
            factors += [Lagged(f"{kind}{channel or 1}", int(lag))] * int(power or 1)
        monomial = tuple(sorted(factors, key=_rank))
        self._check(monomial, f"terms[{place}]: found {text!r}")
        return monomial

    def _from_exponents(self, item: Any, place: int) -> Monomial:
        table = np.asarray(item, dtype=object)
        shell = _regressors(self.ny, self.nu, self.inputs, self.outputs)
        if table.shape != (len(shell),):
            raise ModelError(
                f"terms[{place}]: found shape {table.shape}, expected text or "
                f"{len(shell)} exponents, of {', '.join(self.regressors)}"
            )
        powers = [
            natural(p, f"terms[{place}]", ModelError, most=MOST_TERMS) for p in table.tolist()
        ]
        factors = [r for r, power in zip(shell, powers, strict=True) for _ in range(power)]
        return tuple(sorted(factors, key=_rank))

    def _check(self, monomial: Monomial, found: str) -> None:
        for signal, lag in ((f.signal, f.lag) for f in monomial):
            output, channel = signal[0] == "y", int(signal[1:])
            least, most = (1, self.ny) if output else (0, self.nu)
            channels = self.outputs if output else self.inputs
            if not least <= lag <= most or not 1 <= channel <= channels:
                raise ModelError(
                    f"{found}, expected lags {least}..{most} and channels 1..{channels} "
                    f"of {signal[0]}"
                )

    def _text(self, monomial: Monomial) -> str:
        single = self.inputs == self.outputs == 1
        powers = dict.fromkeys(monomial, 0)
        for factor in monomial:
            powers[factor] += 1
        pieces = [
            _regressor_text(factor, single) + (f"^{power}" if power > 1 else "")
            for factor, power in powers.items()
        ]
        return "*".join(pieces) or "1"

    # ---- structure ----------------------------------------------------------------------

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, output by output."""
        return tuple(name for i in range(self.outputs) for name in self._names(i))

    def _names(self, i: int) -> list[str]:
        label = "c" if self.outputs == 1 else f"c{i + 1}"
        return [f"{label}[{text}]" for text in self.terms[i]]

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        """State difference equations; products of several noisy samples become internal signals.

        Parameters
        ----------
        noisy : collection of str
            Signals that are not known exactly.
        """
        products: dict[str, Equation] = {}
        difference = []
        for i in range(self.outputs):
            terms = [term(1.0, "", Lagged(f"y{i + 1}"))]
            for name, monomial in zip(self._names(i), self._monomials[i], strict=True):
                factors = monomial
                if self.degree_cut:
                    factors = cut_products(monomial, noisy, products, self._text)
                terms.append(term(-1.0, name, *factors))
            difference.append(Equation(f"y{i + 1}", tuple(terms), error=True))
        return (*products.values(), *difference)

    def regression(self) -> tuple[Equation, ...]:
        """State the same equations without internal signals; they are linear in theta."""
        return self.equations()

    def transfer(self, output: int = 1, input: int = 1) -> Transfer:
        """Refuse: a nonlinear structure has no transfer function.

        Parameters
        ----------
        output, input : int
            Channels, from 1.
        """
        raise ModelError(
            "model: found a PolynomialNARX, which has no transfer function, expected a linear "
            "structure"
        )


def _rank(factor: Lagged) -> tuple[bool, int, int]:
    return factor.signal[0] == "u", int(factor.signal[1:]), factor.lag


def _regressors(ny: int, nu: int, inputs: int, outputs: int) -> list[Lagged]:
    past = [Lagged(f"y{i}", lag) for i in range(1, outputs + 1) for lag in range(1, ny + 1)]
    return past + [Lagged(f"u{j}", lag) for j in range(1, inputs + 1) for lag in range(nu + 1)]


def _regressor_text(factor: Lagged, single: bool) -> str:
    kind, channel = factor.signal[0], factor.signal[1:]
    return f"{kind}{factor.lag}" if single else f"{kind}[{channel}]{factor.lag}"
