"""Parts of certificates and problems, written by hand as the second checker reads them."""

from __future__ import annotations

import math

from checker.arithmetic import interval as iv
from checker.arithmetic.polynomial import Polynomial
from checker.certificates.identity import Identity
from checker.certificates.propagation import Box
from checker.files.reading import Constraint, Problem

INF = math.inf


def poly(terms):
    """A polynomial from words, such as (1, 1, 2) for x1^2 x2, and their coefficients."""
    return Polynomial.of(list(terms), [float(c) for c in terms.values()])


def array(kind, *rows):
    """An array of rows, or of blocks of rows, as files hold it."""
    shape, flat = [], list(rows)
    while flat and isinstance(flat[0], (list, tuple)):
        shape.append(len(flat[0]))
        flat = [entry for row in flat for entry in row]
    return {"type": kind, "shape": [len(rows), *shape], "data": flat}


def text(values):
    return [{INF: "inf", -INF: "-inf"}.get(v, v) for v in values]


def scaling(n, **changes):
    """t = x, in [-1, 1] or free or with the ends given."""
    found = {"centre": array("f8", *n * [0.0]), "scale": array("f8", *n * [1.0])}
    found |= {"boxed": array("b1", *n * [True]), "side": array("i8", *n * [0]), "ends": None}
    return found | changes


def free(n, **changes):
    return scaling(n, boxed=array("b1", *n * [False]), **changes)


def group(numbers, basis, values, floor=0.0, place=None):
    return {
        "generator": array("i4", *numbers),
        "basis": array("i4", *basis),
        "values": array("f8", *values),
        "floor": floor,
        "place": place and array("i4", *place),
    }


NO_PRODUCTS = {"type": "i8", "shape": [0, 2], "data": []}


def identity(n, groups, priced=None, products=NO_PRODUCTS, **changes):
    scaled = changes.pop("scaling", scaling(n))
    found = {"scaling": scaled, "multipliers": groups, "products": products, "priced": priced}
    return Identity(found, n, "identity")


def problem(n, objective, rows=(), low=-INF, high=INF, squares=()):
    low, high = ([v] * n if not isinstance(v, list) else v for v in (low, high))
    return Problem(n, poly(objective), list(rows), low, high, ["x"] * n, list(squares))


def ends(box):
    return [iv.exactly(pair) for pair in box.ends]


def box_of(*pairs):
    return Box([iv.around(*pair) for pair in pairs])


PSD = Constraint("PSD", poly({}), [poly({(1,): 1}), poly({(): 1}), poly({(2,): 1})])
