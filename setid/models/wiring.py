"""Connections of blocks and maps, and the equations that follow.

A factor of a row is a number times parameters times lagged signals; maps and transfer
functions are sums of such factors, multiplied out here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.errors import ModelError
from setid.models.equations import Equation, Lagged, Term, Transfer, channel_of, term
from setid.models.lti import Form, expand
from setid.models.maps import StaticMap
from setid.models.products import PRODUCT, cut_products

__all__ = ["Block", "Maps", "Wiring"]

Maps = tuple[tuple[str, StaticMap], ...]


@dataclass(frozen=True, slots=True)
class Block:
    """One entry of the matrix of transfer functions."""

    target: str
    source: tuple[tuple[str, float], ...]  # signal and sign
    na: int
    nb: int
    nk: int

    @property
    def source_text(self) -> str:
        """The source as it was given."""
        text = "".join(f"{'-' if sign < 0 else '+'}{name}" for name, sign in self.source)
        return text.removeprefix("+")

    @property
    def label(self) -> str:
        """Target and source."""
        return f"{self.target},{self.source_text}"


@dataclass(frozen=True, slots=True)
class Wiring:
    """Blocks and maps with the numbers of fixed parameters."""

    blocks: tuple[Block, ...]
    maps: Maps
    fixed: Mapping[str, float]

    # ---- names --------------------------------------------------------------------------

    def transfer(self, block: Block) -> Transfer:
        """Name the coefficients of a block."""
        place = f"[{block.label}]" if len(self.blocks) > 1 else ""
        numerator = tuple(f"b{place}{lag}" for lag in range(block.nk, block.nk + block.nb))
        denominator = tuple(f"a{place}{lag}" for lag in range(1, block.na + 1))
        return Transfer(numerator, denominator, block.nk)

    def weights(self, name: str) -> tuple[str, ...]:
        """Name the coefficients of a map."""
        place = f"[{name}]" if len(self.maps) > 1 else ""
        return tuple(f"gamma{place}{m + 1}" for m in range(len(dict(self.maps)[name].basis)))

    @property
    def names(self) -> tuple[str, ...]:
        """All coefficients: denominators, numerators, maps."""
        transfers = [self.transfer(block) for block in self.blocks]
        return (
            *(name for item in transfers for name in item.denominator),
            *(name for item in transfers for name in item.numerator),
            *(name for target, _ in self.maps for name in self.weights(target)),
        )

    def driven_by(self, signals: Collection[str], maps: bool = False) -> set[str]:
        """List signals, and all that blocks, and maps where asked for, make of them."""
        edges = [(b.target, {name for name, _ in b.source}) for b in self.blocks]
        edges += [(name, set(item.arguments)) for name, item in self.maps if maps]
        found = set(signals)
        while more := {target for target, sources in edges if sources & found} - found:
            found |= more
        return found

    # ---- pieces of rows -----------------------------------------------------------------

    def _settled(self, item: Term) -> Term:
        """A term with the numbers of fixed parameters multiplied in."""
        value = item.coefficient
        for name in item.parameters:
            value *= self.fixed.get(name, 1.0)
        rest = tuple(name for name in item.parameters if name not in self.fixed)
        return Term(value, rest, item.signals)

    def map_terms(self, name: str, noisy: frozenset[str]) -> list[Term]:
        """Write the sum that a map stands for."""
        found, item = [], dict(self.maps)[name]
        for m, weight in enumerate(self.weights(name)):
            powers = item.basis[m]
            if callable(powers):
                noisy_arguments = [a for a in item.arguments if a in noisy]
                if noisy_arguments:
                    raise ModelError(
                        f"nonlinear[{name!r}]: found the basis function {item.text(m)} of "
                        f"{noisy_arguments[0]}, which is not known exactly: its value would not "
                        "be a polynomial of the noise, and rows would not be polynomials; "
                        "expected powers, or an input without noise (output error)"
                    )
                factors = [Lagged(f"phi[{name}]{m + 1}")]
            else:
                pairs = zip(item.arguments, powers, strict=True)
                factors = [Lagged(a) for a, power in pairs for _ in range(power)]
            found.append(self._settled(term(1.0, weight, *factors)))
        return [t for t in found if t.coefficient]

    def _shift_of(self, signal: str) -> tuple[float, Lagged] | None:
        """A signal that is another one with known gain and delay."""
        blocks = [b for b in self.blocks if b.target == signal]
        if len(blocks) != 1 or channel_of(signal) is not None:
            return None
        block, names = blocks[0], self.transfer(blocks[0])
        gain = self.fixed.get(names.numerator[0])
        if block.na or block.nb != 1 or len(block.source) != 1 or gain is None:
            return None
        source, sign = block.source[0]
        return (gain * sign, Lagged(source, block.nk)) if channel_of(source) else None

    def _unshifted(self, item: Term) -> Term:
        """A term without signals that are delayed measured ones."""
        value, factors = item.coefficient, []
        for factor in item.signals:
            found = self._shift_of(factor.signal)
            if found is None:
                factors.append(factor)
                continue
            value *= found[0]
            factors.append(Lagged(found[1].signal, found[1].lag + factor.lag))
        return Term(value, item.parameters, tuple(factors))

    def _map(self, name: str, noisy: frozenset[str]) -> Equation:
        """Name - (its sum) == 0."""
        terms = [Term(-t.coefficient, t.parameters, t.signals) for t in self.map_terms(name, noisy)]
        return self._equation(name, [term(1.0, "", Lagged(name)), *terms])

    def _source(self, signal: str, inserted: Collection[str], noisy: frozenset[str]) -> list[Term]:
        if signal in inserted:
            return self.map_terms(signal, noisy)
        return [term(1.0, "", Lagged(signal))]

    def _difference(
        self,
        name: str,
        blocks: Sequence[Block],
        inserted: Collection[str],
        noisy: frozenset[str],
    ) -> Equation:
        """D_1 ... D_p name - sum of numerators times other denominators times sources."""
        denominators = self._denominators(blocks)
        terms = [Term(1.0, names, (Lagged(name, lag),)) for lag, names in expand(denominators)]
        for block in blocks:
            own = self.transfer(block)
            others = expand([d for d in denominators if d != own.denominator])
            pieces = [
                Term(sign * t.coefficient, t.parameters, t.signals)
                for signal, sign in block.source
                for t in self._source(signal, inserted, noisy)
            ]
            for shift, b in enumerate(own.numerator, own.delay):
                terms += [
                    Term(
                        -piece.coefficient,
                        (*names, b, *piece.parameters),
                        tuple(Lagged(f.signal, f.lag + lag + shift) for f in piece.signals),
                    )
                    for lag, names in others
                    for piece in pieces
                ]
        return self._equation(name, terms)

    def _denominators(self, blocks: Sequence[Block]) -> list[tuple[str, ...]]:
        return [d for d in (self.transfer(b).denominator for b in blocks) if d]

    def _of(self, target: str) -> list[Block]:
        return [b for b in self.blocks if b.target == target]

    def _equation(self, target: str, terms: Sequence[Term], error: bool = True) -> Equation:
        settled = [self._settled(t) for t in terms[1:]]
        kept = [self._unshifted(t) for t in settled if t.coefficient]
        output = channel_of(target) is not None
        return Equation(target, (terms[0], *kept), error=error and output)

    # ---- equations ----------------------------------------------------------------------

    def equations(self, noisy: frozenset[str], form: Form) -> tuple[Equation, ...]:
        """State equations of all signals; see :meth:`BlockStructured.equations`.

        Maps of noisy signals are inserted where one product of parameters is enough for it;
        with more of them the relaxations of the engine were measured to grow too large, and
        the map is an unknown signal.
        """
        found = self._written(noisy, form, True)
        weights = {name for target, _ in self.maps for name in self.weights(target)}
        products = {t.parameters for e in found for t in e.terms if _coupled(t, weights)}
        return found if len(products) <= 1 else self._written(noisy, form, False)

    def _written(self, noisy: frozenset[str], form: Form, also_noisy: bool) -> tuple[Equation, ...]:
        targets = {b.target for b in self.blocks} | {name for name, _ in self.maps}
        unknown = noisy | {name for name in targets if channel_of(name) is None}
        inserted = {
            name
            for name, item in self.maps
            if form != "partial"
            and channel_of(name) is None
            and all(channel_of(a) is not None for a in item.arguments)
            and (also_noisy or not any(a in unknown for a in item.arguments))
        }
        found: list[Equation] = []
        for name, _ in self.maps:
            if name not in inserted:
                found.append(self._map(name, noisy))
        several = form == "partial" or (form == "auto" and not self.direct(noisy))
        for target in dict.fromkeys(b.target for b in self.blocks):
            if self._shift_of(target) is not None:
                continue
            if several and len(self._of(target)) > 1 and self._denominators(self._of(target)):
                found += self._partial(target, inserted, noisy)
            else:
                found.append(self._difference(target, self._of(target), inserted, noisy))
        return self._bilinear(_ordered(found), unknown)

    def direct(self, noisy: frozenset[str]) -> tuple[Equation, ...]:
        """State outputs in measured signals alone; see :meth:`BlockStructured.direct`."""
        inserted = {name for name, _ in self.maps if channel_of(name) is None}
        found = [self._map(name, noisy) for name, _ in self.maps if channel_of(name) is not None]
        outputs = [b.target for b in self.blocks if channel_of(b.target) is not None]
        found += [self._difference(t, self._of(t), inserted, noisy) for t in dict.fromkeys(outputs)]
        used = {s for e in found for s in e.signals}
        known = {s for s in used if channel_of(s) is not None or s.startswith("phi[")}
        return tuple(found) if used == known else ()

    def _partial(
        self,
        target: str,
        inserted: Collection[str],
        noisy: frozenset[str],
    ) -> list[Equation]:
        """V = G r for each entry, then target = sum of v."""
        blocks = self._of(target)
        names = [f"v[{block.label}]" for block in blocks]
        total = [term(1.0, "", Lagged(target)), *(term(-1.0, "", Lagged(v)) for v in names)]
        found = [
            self._difference(v, [b], inserted, noisy) for v, b in zip(names, blocks, strict=True)
        ]
        return [*found, self._equation(target, total, error=False)]

    def _bilinear(
        self, equations: Sequence[Equation], unknown: Collection[str]
    ) -> tuple[Equation, ...]:
        """Products of unknown samples that meet a parameter become signals of their own."""
        hidden = set(unknown) | {e.defines for e in equations if channel_of(e.defines) is None}
        products: dict[str, Equation] = {}
        found: list[Equation] = []
        for equation in equations:
            fresh = dict(products)
            terms = tuple(
                Term(t.coefficient, t.parameters, cut_products(t.signals, hidden, products, _text))
                if t.parameters or len(t.signals) > 2
                else t
                for t in equation.terms
            )
            found += [item for name, item in products.items() if name not in fresh]
            found.append(Equation(equation.defines, terms, equation.error))
        return tuple(found)

    def driven(self, inputs: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Evaluate basis functions that are not powers; see :meth:`BlockStructured.driven`."""
        found = {}
        for name, item in self.maps:
            for m, entry in enumerate(item.basis):
                if callable(entry):
                    columns = [inputs[:, int(a[1:]) - 1] for a in item.arguments]
                    found[f"phi[{name}]{m + 1}"] = item.value(m, *columns)
        return found


def _coupled(item: Term, weights: Collection[str]) -> bool:
    """Check for a product of parameters that meets powers of unknown samples."""
    several = len(item.parameters) > 1 and any(name in weights for name in item.parameters)
    return several and any(s.signal.startswith(PRODUCT) for s in item.signals)


def _text(monomial: tuple[Lagged, ...]) -> str:
    powers = dict.fromkeys(monomial, 0)
    for factor in monomial:
        powers[factor] += 1
    return "*".join(
        f"{f.signal}{f'({f.lag})' if f.lag else ''}" + (f"^{power}" if power > 1 else "")
        for f, power in powers.items()
    )


def _ordered(equations: Sequence[Equation]) -> list[Equation]:
    """Internal signals before those that use them at the same sample, where that is possible."""
    rest, found = list(equations), list[Equation]()
    while rest:
        waiting = {e.defines for e in rest if channel_of(e.defines) is None}
        ready = (
            [e for e in rest if not any(s in waiting and s != e.defines for s in e.signals)]
            or [e for e in rest if channel_of(e.defines) is None][:1]
            or rest[:1]
        )
        found += ready[:1]
        rest.remove(ready[0])
    return found
