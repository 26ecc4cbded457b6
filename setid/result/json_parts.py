"""Parts of identifications as JSON: records, structures, noise, priors, boxes.

Classes are written by name with their fields and read through their constructors, which check them.
Functions have no text: structures, noise sets and priors made of them are refused.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from fractions import Fraction
from functools import cache
from importlib import import_module
from math import isfinite
from typing import Any, cast

import numpy as np

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, entries_of
from setid.data.noise import EnergyBound, Noise, RateLimit
from setid.data.record import IOData
from setid.errors import NoiseError, SetidError
from setid.models.block import BlockStructured
from setid.models.lti import TransferFunction
from setid.models.narx import PolynomialNARX
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox, Limit
from setid.proofs.denominators.denominator_cells import Cell, DenominatorCells, VaryingLeaf
from setid.proofs.denominators.varying_multipliers import VaryingCells
from setid.proofs.fields import check_fields
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.simulated.tree import SimulatedBox, Step, TreeNode
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.result.damaged_texts import refused
from sparsepop_py.io.json_files.certificates import CERTIFICATE
from sparsepop_py.io.json_files.codecs import array, rational
from sparsepop_py.io.json_files.values import CONSTRAINT
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox
from sparsepop_py.verified.uncertain_rows.sign_tree import LeftInverse, ParameterBox, SignTree
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import CoefficientLimit

__all__ = ["check_attained", "read", "write"]

_ROUNDED = 1e-9  # relative distance of an attained end from the outer interval, by rounding

_ROOMS = ("setid.models", "setid.priors")  # whose dataclasses are written field by field
_OTHERS: tuple[type, ...] = (
    IOData,
    Noise,
    EnergyBound,
    RateLimit,
    ParameterBox,
    DirectionBox,
    LiftedBox,
    CellBox,
    SimulatedBox,
    TreeNode,
    Step,
    Unbounded,
    LeftInverse,
    SignTree,
    CoefficientLimit,
    DenominatorCells,
    VaryingCells,
    DenominatorBox,
    Limit,
    Cell,
    VaryingLeaf,
    sp.LinearBound,
)
_NUMBERS = {"inf": np.inf, "-inf": -np.inf, "nan": np.nan}
_FOREIGN = {sp.Certificate: CERTIFICATE}


def write(value: Any, place: str = "result") -> Any:
    """Convert a part of an identification to what ``json.dumps`` takes.

    Parameters
    ----------
    value : object
    place : str
        Where it stands, for messages.

    Raises
    ------
    SetidError
        If it holds a function or an object of an unknown class.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return {"is": type(value).__name__, "value": value.name}
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else {"is": "float", "value": str(value)}
    if isinstance(value, Fraction):
        return {"is": "Fraction", "value": str(value)}
    if isinstance(value, np.ndarray):
        return {"is": "array", **array.write(value)}
    return _write_many(value, place)


def _write_many(value: Any, place: str) -> Any:
    name = type(value).__name__
    if type(value) is sp.Constraint:
        names = value.polynomial.names
        return {"is": name, "value": CONSTRAINT.write(value), "names": names and list(names)}
    if type(value) in _FOREIGN:
        return {"is": name, "value": _FOREIGN[type(value)].write(value)}
    if type(value) is _classes().get(name):
        parts = {key: write(getattr(value, key), f"{place}.{key}") for key in _fields(value)}
        return {"is": name, "fields": parts}
    if type(value) is tuple or isinstance(value, list):
        return [write(item, f"{place}[{k}]") for k, item in enumerate(value)]
    if isinstance(value, Mapping):
        items = [[write(k, place), write(v, f"{place}[{k!r}]")] for k, v in value.items()]
        return {"is": "mapping", "items": items}
    raise SetidError(
        f"{place}: found {value!r:.60}, of which there is no text; expected structures, noise and "
        "priors of setid without functions"
    )


def read(found: Any, place: str = "result") -> Any:
    """Read what :func:`write` made; constructors check what they are given.

    Parameters
    ----------
    found : object
        As ``json.loads`` returns it.
    place : str

    Raises
    ------
    SetidError
        Naming the place, what was found and what was expected.
    """
    if found is None or isinstance(found, (bool, int, float, str)):
        return found
    if isinstance(found, list):
        return tuple(read(item, f"{place}[{k}]") for k, item in enumerate(found))
    if not isinstance(found, dict) or not isinstance(found.get("is"), str):
        raise SetidError(f"{place}: found {found!r:.60}, expected a value with its class")
    with refused(place, f"a {found['is']:.60}"):
        return _read_object(found["is"], found, place)


def check_attained(
    intervals: Mapping[str, ParameterInterval], sizes: Sequence[float] | None = None
) -> None:
    """Refuse attained ends outside of proved intervals, which verification has no need to.

    Values at most 5 and at least -5 may well exist where every value lies in [-1, 1].

    Parameters
    ----------
    intervals : mapping of str to ParameterInterval
    sizes : sequence of float, optional
        Units of the parameters, in which attained points are known up to rounding: zero is where
        the outer ends are.

    Raises
    ------
    SetidError
        Naming the end.
    """
    for size, (name, item) in zip(sizes or [0.0] * len(intervals), intervals.items(), strict=True):
        room = _ROUNDED * max([size, *(abs(end) for end in item.outer if isfinite(end))])
        for end in item.inner or ():
            if not item.outer[0] - room <= end <= item.outer[1] + room:
                low, high = item.outer
                raise SetidError(
                    f"from_json: found {end!r} attained by {name}, expected it in [{low}, {high}]"
                )


def _read_object(name: str, found: dict[str, Any], place: str) -> Any:
    if name in _SIMPLE:
        return _SIMPLE[name](found, place)
    for known in (IntervalStatus, sp.Status):
        if name == known.__name__:
            return known[found["value"]]
    for foreign, codec in _FOREIGN.items():
        if name == foreign.__name__:
            return codec.read(found["value"], place)
    if name not in _classes():
        raise SetidError(f"{place}: found a {name!r:.60}, expected a class of setid")
    kind = _classes()[name]
    parts = {key: read(value, f"{place}.{key}") for key, value in found["fields"].items()}
    made = _made(kind, parts)
    check_fields(made, place)
    return made


def _constraint(found: dict[str, Any], place: str) -> sp.Constraint:
    """A constraint, with the names of its variables."""
    bare: sp.Constraint = CONSTRAINT.read(found["value"], place)
    left = bare.polynomial
    named = sp.Polynomial.from_words(
        left.words, left.coefficients, left.dimension, found.get("names")
    )
    return replace(bare, polynomial=named)


def _mapping(found: dict[str, Any], place: str) -> FrozenMapping[Any, Any]:
    pairs = [(read(k, place), read(v, f"{place}[{k!r}]")) for k, v in found["items"]]
    return FrozenMapping(dict(pairs))


_SIMPLE: dict[str, Callable[[dict[str, Any], str], Any]] = {
    "float": lambda found, place: _NUMBERS[found["value"]],
    "Fraction": lambda found, place: rational.read(found["value"], place),
    "array": array.read,
    "mapping": _mapping,
    "Constraint": _constraint,
}


def _made(kind: type, parts: dict[str, Any]) -> Any:
    """An object from its fields, through its constructor."""
    if kind is Noise:
        extra = {key: parts.pop(key) for key in ("assumptions", "model_error")}
        noise = Noise(**parts).covering(extra["model_error"])
        texts = entries_of(extra["assumptions"], "assumptions", "texts", NoiseError)
        if not all(isinstance(text, str) for text in texts):
            raise NoiseError(f"assumptions: found {texts!r:.60}, expected texts")
        object.__setattr__(noise, "assumptions", tuple(texts))
        return noise
    if issubclass(kind, BlockStructured):
        return _block_structure(kind, parts)
    if kind is PolynomialNARX:
        terms = [list(items) for items in parts.pop("terms")]
        return PolynomialNARX(terms if len(terms) > 1 else terms[0], **parts)
    return kind(**parts)


def _block_structure(kind: type[BlockStructured], parts: dict[str, Any]) -> BlockStructured:
    """A block structure; blocks and maps are those that the general constructor makes of them."""
    linear = {
        (b.target, b.source_text): TransferFunction(na=b.na, nb=b.nb, nk=b.nk)
        for b in parts["blocks"]
    }
    general = BlockStructured(
        linear,
        dict(parts["maps"]),
        parts["inputs"],
        parts["outputs"],
        None,
        parts["initial"],
        parts["form"],
    )
    fixed, gains = parts["fixed"], parts["unit_gain"]
    known = {name for name, _ in fixed} <= set(general.parameters) and all(
        type(value) in (int, float) for _, value in fixed
    )
    if (general.blocks, general.maps) != (parts["blocks"], parts["maps"]) or not known:
        raise SetidError("structure: found blocks, maps and fixed numbers that do not fit together")
    if not set(gains) <= {block.label for block in general.blocks}:
        raise SetidError(f"structure: found {gains!r}, expected labels of blocks")
    made = general.changed(fixed=tuple((n, float(v)) for n, v in fixed), unit_gain=gains)
    if kind is BlockStructured:
        return made
    own: BlockStructured = object.__new__(kind)
    for item in fields(BlockStructured):
        object.__setattr__(own, item.name, getattr(made, item.name))
    return own


def _fields(value: Any) -> list[str]:
    if not is_dataclass(value):
        return list(value._fields)  # a named tuple
    return [f.name for f in fields(value) if not f.name.startswith("_")]


@cache
def _classes() -> dict[str, type]:
    """Classes by name: of boxes and records, and all dataclasses of structures and priors."""
    found = {kind.__name__: kind for kind in _OTHERS}
    for room in _ROOMS:
        for module in pkgutil.walk_packages(import_module(room).__path__, f"{room}."):
            for name, one in vars(import_module(module.name)).items():
                own = isinstance(one, type) and one.__module__ == module.name
                if own and is_dataclass(one) and not name.startswith("_"):
                    found.setdefault(name, cast(type, one))
    structures: list[type] = [BlockStructured, *BlockStructured.__subclasses__()]
    for kind in structures:
        if kind.__module__.startswith("setid."):
            found[kind.__name__] = kind
    return found
