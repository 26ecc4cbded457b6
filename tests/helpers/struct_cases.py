"""Structs of SparsePOP."""

from __future__ import annotations

from typing import Any

import numpy as np


def struct(supports: Any, coef: Any, cone: int = 1, **changes: Any) -> dict[str, Any]:
    """A polynomial by rows of exponents; a field that is changed to None is left out."""
    table = np.array(supports, float)
    fields = {
        "typeCone": cone,
        "sizeCone": 1,
        "dimVar": table.shape[1],
        "degree": int(table.sum(axis=1).max()),
        "noTerms": table.shape[0],
        "supports": table,
        "coef": np.array(coef, float).reshape(-1, 1),
    }
    return {key: value for key, value in (fields | changes).items() if value is not None}
