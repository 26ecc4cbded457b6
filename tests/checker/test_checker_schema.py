"""The JSON Schema holds what is written; a small validator, since the package needs none."""

from __future__ import annotations

import functools
import json
import re
from importlib import resources
from typing import Any

import pytest
from certificate_corpus import FEW, solved
from record_corpus import written

SCHEMA = json.loads(
    resources.files("sparsepop_py").joinpath("certificate_schema.json").read_text(encoding="utf-8")
)
KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def is_kind(value: Any, kind: str) -> bool:
    if kind in KINDS:
        return isinstance(value, KINDS[kind])
    whole = isinstance(value, int) and not isinstance(value, bool)
    return whole if kind == "integer" else whole or isinstance(value, float)


def inside(value: Any, schema: dict) -> bool:
    """Whether members of objects and lists are as they should be."""
    if isinstance(value, dict):
        known = schema.get("properties", {})
        members = [(value[key], known[key]) for key in value if key in known]
        unknown = set(value) - set(known)
        if schema.get("additionalProperties") is False and unknown:
            return False
    elif isinstance(value, list):
        first = schema.get("prefixItems", [])
        members = list(zip(value, first, strict=False))
        members += [(v, schema["items"]) for v in value if "items" in schema]
    else:
        members = []
    return all(valid(member, own) for member, own in members)


def limits(value: Any, schema: dict) -> bool:
    """Whether sizes, numbers and texts are within their limits."""
    if isinstance(value, list):
        return schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
    if is_kind(value, "number"):
        least, above = schema.get("minimum", value), schema.get("exclusiveMinimum", value - 1)
        return value >= least and value > above
    return not isinstance(value, str) or re.search(schema.get("pattern", ""), value) is not None


@functools.cache
def defined(name: str) -> dict:
    return SCHEMA["$defs"][name.removeprefix("#/$defs/")]


def valid(value: Any, schema: dict) -> bool:
    """Whether a value is valid, by the keywords that this schema uses."""
    if "$ref" in schema and not valid(value, defined(schema["$ref"])):
        return False
    if "type" in schema and not is_kind(value, schema["type"]):
        return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, dict) and not set(schema.get("required", ())) <= set(value):
        return False
    if not all(valid(value, part) for part in schema.get("allOf", ())):
        return False
    for word, most in (("anyOf", len(schema.get("anyOf", ()))), ("oneOf", 1)):
        if word in schema and not 1 <= sum(valid(value, p) for p in schema[word]) <= most:
            return False
    return limits(value, schema) and inside(value, schema)


KEYWORDS = {"$ref", "type", "const", "enum", "required", "properties", "items", "prefixItems"}
KEYWORDS |= {"minItems", "maxItems", "minimum", "exclusiveMinimum", "pattern", "description"}
KEYWORDS |= {"anyOf", "oneOf", "allOf", "additionalProperties", "$schema", "$defs", "title"}


def test_the_validator_knows_every_keyword():
    stack: list[Any] = [(SCHEMA, True)]
    while stack:
        found, names = stack.pop()
        if isinstance(found, dict):
            assert not names or set(found) <= KEYWORDS
            for key, value in found.items():
                if key not in ("const", "enum", "required"):
                    stack.append((value, not names or key not in ("properties", "$defs")))
        elif isinstance(found, list):
            stack += [(value, names) for value in found]


@pytest.mark.parametrize("group", ["known", "trees", "matrices", "families", "chains", "switches"])
def test_results_are_valid(group):
    for name, text in solved(group, FEW[group]).items():
        assert valid(json.loads(text), SCHEMA), name


@pytest.mark.parametrize(
    "name",
    [
        "e-0",
        "o-0",
        "narx",
        "simulated-free-0",
        "cones-second",
        "two-poles-driven",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("strong-o", "two-poles-o")),
    ],
)
def test_identifications_are_valid(name):
    assert valid(json.loads(written(name)), SCHEMA)


@pytest.mark.parametrize("field", ["structure", "intervals", "ends"])
def test_rows_inside_of_an_identification_are_looked_at(field):
    found = json.loads(written("two-poles-driven"))
    found["identification"]["driven"][field] = 1.0
    assert not valid(found, SCHEMA)
    del found["identification"]["driven"][field]
    assert not valid(found, SCHEMA)


@pytest.mark.parametrize("field", ["lower_bound", "status", "problem", "certificate"])
def test_what_lacks_a_field_or_has_another_type_is_not(field):
    found = json.loads(solved("known", 6)["disc"])
    found["result"][field] = [1.0]
    assert not valid(found, SCHEMA)
    del found["result"][field]
    assert not valid(found, SCHEMA)


def test_shapes_in_parts_are_looked_at():
    found = json.loads(solved("known", 6)["disc"])
    part = found["result"]["certificate"][-1]["parts"][0]
    group = part["argument"]["multipliers"][0]
    group["floor"] = -1.0
    assert not valid(found, SCHEMA)
    group["floor"] = 0.0
    assert valid(found, SCHEMA)
    part["argument"]["is"] = "Other"
    assert not valid(found, SCHEMA)
