"""Certificates as JSON: lists of parts, and lists of certificates with quoted ones first."""

from __future__ import annotations

from typing import Any

from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.codecs import (
    Codec,
    array,
    flag,
    number,
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
    lambda found, place: sequence(array).read(found, place),
)
SCALING = record(Scaling, centre=array, scale=array, boxed=array, side=array, ends=optional(_ENDS))
MULTIPLIERS = record(
    Multipliers, generator=array, basis=array, values=array, floor=number, place=optional(array)
)
PRICED = record(Priced, words=array, values=array)
IDENTITY = record(
    Identity,
    scaling=SCALING,
    multipliers=sequence(MULTIPLIERS),
    products=array,
    priced=optional(PRICED),
)
LINEAR = record(
    LinearDual,
    scaling=SCALING,
    generator=array,
    word=array,
    value=array,
    owner=array,
    products=array,
)
PROPAGATION = record(Propagation, sweeps=whole, uses_cutoff=flag)
SUBLEVEL = record(Sublevel, identity=IDENTITY, cutoff=number)
INVERSE = record(
    LeftInverse, rows=array, variables=array, inverse=array, centre=array, radius=array
)
GRAM = record(ExactGram, basis=array, first=array, second=array, value=array)
EXACT = record(
    ExactDual,
    lower=array,
    upper=array,
    row=array,
    word=array,
    value=sequence(rational),
    gram=optional(tagged({ExactGram: GRAM})),
)
ARGUMENT = tagged({Identity: IDENTITY, LinearDual: LINEAR, ExactGram: GRAM, ExactDual: EXACT})
_DUAL = tagged({Identity: IDENTITY, LinearDual: LINEAR, ExactDual: EXACT})
TIGHTENING = record(
    Tightening, variable=array, side=array, value=array, argument=_DUAL, uses_cutoff=flag
)
_BRANCH = Codec(
    lambda branch: [int(branch[0]), number.write(branch[1])],
    lambda found, place: (whole.read(_two(found, place)[0], place), number.read(found[1], place)),
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

    def take(self, found: Any, place: str) -> Certificate:
        """Read one certificate, whose quotes have been read."""

        def part(name: str, codec: Codec) -> Any:
            return codec.read(codecs.field_of(found, name, place), f"{place}.{name}")

        parts = codecs.field_of(found, "parts", place)
        if not isinstance(parts, list) or not parts:
            raise codecs.wrong(f"{place}.parts", parts, "a list of parts")
        nodes: dict[int, Node] = {}
        for k in range(len(parts) - 1, -1, -1):
            nodes[k] = self._node(parts[k], f"{place}.parts[{k}]", k, nodes)
        certificate = Certificate(
            part("fingerprint", text),
            part("bound", number),
            nodes[0],
            part("cutoff", optional(number)),
            part("correction", number),
            part("assumptions", sequence(text)),
        )
        self.read_already.append(certificate)
        return certificate

    def _node(self, found: Any, place: str, own: int, nodes: dict[int, Node]) -> Node:
        def part(name: str, codec: Codec) -> Any:
            return codec.read(codecs.field_of(found, name, place), f"{place}.{name}")

        children = part("children", sequence(whole))
        if any(not own < child <= own + len(nodes) for child in children):
            raise codecs.wrong(f"{place}.children", list(children), "numbers of later parts")
        return Node(
            BoxProof(part("steps", sequence(self.steps))),
            part("argument", optional(ARGUMENT)),
            part("empty", flag),
            part("branch", optional(_BRANCH)),
            tuple(nodes[child] for child in children),
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
    table = _Certificates()
    for k, entry in enumerate(found):
        table.take(entry, f"{place}[{k}]")
    return table.read_already[-1]


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
    table = _Certificates()
    for k, entry in enumerate(listed):
        table.take(entry, f"{place}[{k}]")
    for number_ in numbers:
        if number_ is not None and not 0 <= number_ < len(table.read_already):
            raise codecs.wrong(place, number_, f"a number below {len(table.read_already)}")
    return tuple(None if n is None else table.read_already[n] for n in numbers)


CERTIFICATES = Codec(_write_certificates, _read_certificates)
