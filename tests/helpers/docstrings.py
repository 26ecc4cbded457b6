"""What signatures take and docstrings explain."""

from __future__ import annotations

import inspect
import re


def documented(text: str) -> set[str]:
    """Names in the Parameters section of a NumPy docstring."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\S[^\n]*\n-{3,}$|\Z)", text, re.M | re.S)
    lines = section.group(1).splitlines() if section else []
    heads = [line.split(" : ")[0] for line in lines if line and not line[0].isspace()]
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


def parameters(thing: object) -> set[str]:
    return {
        name
        for name in inspect.signature(thing).parameters
        if name not in ("self", "cls") and not name.startswith("_")
    }
