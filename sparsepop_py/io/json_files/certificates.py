"""Certificates as JSON: lists of parts, and lists of certificates with quoted ones first."""

from __future__ import annotations

import math
from collections.abc import Sized
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.monomials import Words
from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.codecs import (
    Codec,
    array,
    array_of,
    checked,
    finite,
    flag,
    number,
    number_of,
    optional,
    rational,
    record,
    sequence,
    tagged,
    text,
    whole,
)
from sparsepop_py.verified.box.left_inverse import LeftInverse
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers, Priced
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Known,
    Propagation,
    Sublevel,
    Tightening,
)

__all__ = ["CERTIFICATE", "CERTIFICATES"]

_ENDS = Codec(
    lambda ends: [array.write(end) for end in ends],
    lambda found, place: sequence(array_of("F", 1)).read(_two(found, place), place),
)
_FLOOR = number_of("a finite number >= 0", lambda value: 0 <= value < math.inf)
_WORDS, _WHOLE, _NUMBERS = array_of("i", 2), array_of("i", 1), array_of("f", 1)


def _check_scaling(scaling: Scaling, place: str) -> None:
    """Refuse scalings that hold no real t, or turn a variable around."""
    parts = (scaling.centre, scaling.scale, scaling.boxed, scaling.side, *(scaling.ends or ()))
    sizes = [part.size for part in parts]
    if len(set(sizes)) > 1:
        raise codecs.wrong(place, sizes, "as many numbers of each kind")
    low, high = scaling.bounds
    far = np.where(scaling.boxed, 1.0, np.inf)
    real = (-far <= low) & (low <= high) & (high <= far) & (low < np.inf) & (high > -np.inf)
    sound = real & ((scaling.scale > 0) | (scaling.boxed & (scaling.scale == 0)))
    if not sound.all():
        v = int(np.argmin(sound))
        raise codecs.wrong(
            place,
            f"t{v + 1} in [{low[v]}, {high[v]}], scale {scaling.scale[v]}",
            "a range of real numbers, within [-1, 1] where boxed, and a positive scale",
        )


def _check_letters(words: Words, dimension: int, place: str) -> None:
    """Refuse words with letters outside 0, ..., n."""
    bad = words[(words < 0) | (words > dimension)]
    if bad.size:
        raise codecs.wrong(place, int(bad[0]), f"0 or a variable in 1..{dimension}")


def _check_lengths(place: str, *arrays: Sized) -> None:
    """Refuse arrays of several lengths."""
    sizes = [len(each) for each in arrays]
    if len(set(sizes)) > 1:
        raise codecs.wrong(place, sizes, "arrays of one length")


def _check_products(products: NDArray[Any], place: str) -> None:
    if products.shape[1] != 2:
        raise codecs.wrong(f"{place}.products", list(products.shape), "pairs of generators")


def _check_group(group: Multipliers, place: str) -> None:
    if not group.consistent:
        shapes = [list(group.basis.shape), list(group.values.shape)]
        raise codecs.wrong(place, shapes, "shapes of basis and values that belong together")


def _check_identity(identity: Identity, place: str) -> None:
    n = identity.scaling.centre.size
    _check_products(identity.products, place)
    for k, group in enumerate(identity.multipliers):
        _check_letters(group.basis, n, f"{place}.multipliers[{k}].basis")
    if identity.priced is not None:
        _check_lengths(f"{place}.priced", identity.priced.words, identity.priced.values)
        _check_letters(identity.priced.words, n, f"{place}.priced.words")


def _check_linear(dual: LinearDual, place: str) -> None:
    _check_products(dual.products, place)
    _check_lengths(place, dual.generator, dual.word, dual.value, dual.owner)
    _check_letters(dual.word, dual.scaling.centre.size, f"{place}.word")


def _check_exact(dual: ExactDual, place: str) -> None:
    _check_lengths(place, dual.lower, dual.upper)
    _check_lengths(place, dual.row, dual.word, dual.value)
    _check_letters(dual.word, dual.lower.size, f"{place}.word")


def _check_tightening(step: Tightening, place: str) -> None:
    _check_lengths(place, step.variable, step.side, step.value)
    if np.any(np.abs(step.side) != 1):
        raise codecs.wrong(f"{place}.side", step.side.tolist(), "1 and -1")
    if not isinstance(step.argument, LinearDual) and step.value.size != 1:
        raise codecs.wrong(place, f"{step.value.size} bounds", "one bound, or a LinearDual")


SCALING = checked(
    record(
        Scaling,
        centre=_NUMBERS,
        scale=_NUMBERS,
        boxed=array_of("b", 1),
        side=_WHOLE,
        ends=optional(_ENDS),
    ),
    _check_scaling,
)
MULTIPLIERS = checked(
    record(
        Multipliers,
        generator=_WHOLE,
        basis=array_of("i", 3),
        values=array_of("f", 2, 3),
        floor=_FLOOR,
        place=optional(array_of("i", 2)),
    ),
    _check_group,
)
PRICED = record(Priced, words=_WORDS, values=_NUMBERS)
IDENTITY = checked(
    record(
        Identity,
        scaling=SCALING,
        multipliers=sequence(MULTIPLIERS),
        products=_WORDS,
        priced=optional(PRICED),
    ),
    _check_identity,
)
LINEAR = checked(
    record(
        LinearDual,
        scaling=SCALING,
        generator=_WHOLE,
        word=_WORDS,
        value=_NUMBERS,
        owner=_WHOLE,
        products=_WORDS,
    ),
    _check_linear,
)
PROPAGATION = record(Propagation, sweeps=whole, uses_cutoff=flag)
SUBLEVEL = record(Sublevel, identity=IDENTITY, cutoff=finite)
INVERSE = record(
    LeftInverse,
    rows=_WHOLE,
    variables=_WHOLE,
    inverse=array_of("f", 2),
    centre=_NUMBERS,
    radius=_NUMBERS,
)
GRAM = record(ExactGram, basis=_WORDS, first=_WHOLE, second=_WHOLE, value=_NUMBERS)
EXACT = checked(
    record(
        ExactDual,
        lower=array_of("F", 1),
        upper=array_of("F", 1),
        row=_WHOLE,
        word=_WORDS,
        value=sequence(rational),
        gram=optional(tagged({ExactGram: GRAM})),
    ),
    _check_exact,
)
ARGUMENT = tagged({Identity: IDENTITY, LinearDual: LINEAR, ExactGram: GRAM, ExactDual: EXACT})
_DUAL = tagged({Identity: IDENTITY, LinearDual: LINEAR, ExactDual: EXACT})
TIGHTENING = checked(
    record(
        Tightening,
        variable=_WHOLE,
        side=_WHOLE,
        value=array_of("F", 1),
        argument=_DUAL,
        uses_cutoff=flag,
    ),
    _check_tightening,
)
_BRANCH = Codec(
    lambda branch: [int(branch[0]), number.write(branch[1])],
    lambda found, place: (whole.read(_two(found, place)[0], place), finite.read(found[1], place)),
)


def _two(found: Any, place: str) -> Any:
    if not isinstance(found, list) or len(found) != 2:
        raise codecs.wrong(place, found, "two numbers")
    return found


class _Certificates:
    """Certificates in a list; those that are quoted come before those that quote them."""

    def __init__(self) -> None:
        self.numbers: dict[int, int] = {}
        self.written: list[Any] = []
        self.read_already: list[Certificate] = []
        known = Codec(self._write_known, self._read_known)
        self.steps = tagged(
            {
                Propagation: PROPAGATION,
                Sublevel: SUBLEVEL,
                LeftInverse: INVERSE,
                Tightening: TIGHTENING,
                Known: known,
            }
        )

    def add(self, certificate: Certificate) -> None:
        """Write a certificate and first those that it quotes, without recursion."""
        stack = [(certificate, False)]
        while stack:
            one, ready = stack.pop()
            if id(one) in self.numbers:
                continue
            if not ready:
                stack.append((one, True))
                stack += [(proof, False) for _, _, proof in one.quotes]
                continue
            entry = self._entry(one)
            self.numbers[id(one)] = len(self.written)
            self.written.append(entry)

    def _entry(self, certificate: Certificate) -> dict[str, Any]:
        nodes = list(certificate.root)
        place = {id(node): k for k, node in enumerate(nodes)}
        return {
            "fingerprint": certificate.fingerprint,
            "bound": number.write(certificate.bound),
            "cutoff": optional(number).write(certificate.cutoff),
            "correction": number.write(certificate.correction),
            "assumptions": list(certificate.assumptions),
            "parts": [
                {
                    "steps": [self.steps.write(step) for step in node.box.steps],
                    "argument": optional(ARGUMENT).write(node.argument),
                    "empty": bool(node.empty),
                    "branch": optional(_BRANCH).write(node.branch),
                    "children": [place[id(child)] for child in node.children],
                }
                for node in nodes
            ],
        }

    def take(self, listed: list[Any], place: str) -> list[Certificate]:
        """Read certificates, each after those that it quotes."""
        for k, entry in enumerate(listed):
            self.read_already.append(self._certificate(entry, f"{place}[{k}]"))
        return self.read_already

    def _certificate(self, found: Any, place: str) -> Certificate:
        part = codecs.reader_of(found, place)
        parts = codecs.field_of(found, "parts", place)
        if not isinstance(parts, list) or not parts:
            raise codecs.wrong(f"{place}.parts", parts, "a list of parts")
        nodes: dict[int, Node] = {}
        for k in range(len(parts) - 1, -1, -1):
            nodes[k] = self._node(parts[k], f"{place}.parts[{k}]", nodes)
        return Certificate(
            part("fingerprint", text),
            part("bound", codecs.bound),
            nodes[0],
            part("cutoff", optional(finite)),
            part("correction", number),
            part("assumptions", sequence(text)),
        )

    def _node(self, found: Any, place: str, nodes: dict[int, Node]) -> Node:
        part = codecs.reader_of(found, place)
        children = part("children", sequence(whole))
        if any(child not in nodes for child in children) or len(set(children)) < len(children):
            expected = "numbers of later parts, each once in a tree"
            raise codecs.wrong(f"{place}.children", list(children), expected)
        branch = part("branch", optional(_BRANCH))
        if len(children) != (0 if branch is None else 2):
            raise codecs.wrong(f"{place}.children", list(children), "two of a branch, else none")
        return Node(
            BoxProof(part("steps", sequence(self.steps))),
            part("argument", optional(ARGUMENT)),
            part("empty", flag),
            branch,
            tuple(nodes.pop(child) for child in children),
        )

    def _write_known(self, step: Known) -> dict[str, Any]:
        return {"bounds": [[int(v), int(s), self.numbers[id(p)]] for v, s, p in step.bounds]}

    def _read_known(self, found: Any, place: str) -> Known:
        bounds = []
        rows = codecs.field_of(found, "bounds", place)
        if not isinstance(rows, list):
            raise codecs.wrong(f"{place}.bounds", rows, "a list")
        for k, row in enumerate(rows):
            here = f"{place}.bounds[{k}]"
            triple = sequence(whole).read(row, here)
            if len(triple) != 3 or not 0 <= triple[2] < len(self.read_already):
                raise codecs.wrong(here, row, "variable, side and the number of a certificate")
            bounds.append((triple[0], triple[1], self.read_already[triple[2]]))
        return Known(tuple(bounds))


def _write_certificate(certificate: Certificate) -> list[Any]:
    table = _Certificates()
    table.add(certificate)
    return table.written


def _read_certificate(found: Any, place: str) -> Certificate:
    if not isinstance(found, list) or not found:
        raise codecs.wrong(place, found, "a list of certificates")
    return _Certificates().take(found, place)[-1]


CERTIFICATE = Codec(_write_certificate, _read_certificate)


def _write_certificates(certificates: Any) -> dict[str, Any]:
    """Several certificates, None among them, with one list for all that they quote."""
    table = _Certificates()
    for certificate in certificates:
        if certificate is not None:
            table.add(certificate)
    numbers = [None if c is None else table.numbers[id(c)] for c in certificates]
    return {"certificates": table.written, "numbers": numbers}


def _read_certificates(found: Any, place: str) -> tuple[Certificate | None, ...]:
    listed = codecs.field_of(found, "certificates", place)
    numbers = sequence(optional(whole)).read(codecs.field_of(found, "numbers", place), place)
    if not isinstance(listed, list):
        raise codecs.wrong(place, listed, "a list of certificates")
    read = _Certificates().take(listed, place)
    for number_ in numbers:
        if number_ is not None and not 0 <= number_ < len(read):
            raise codecs.wrong(place, number_, f"a number below {len(read)}")
    return tuple(None if n is None else read[n] for n in numbers)


CERTIFICATES = Codec(_write_certificates, _read_certificates)
