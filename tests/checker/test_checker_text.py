"""Problems as text and as .gms of the second checker, by hand; and reciprocals and levels."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import pytest
from hand_made_proofs import poly, problem

from checker.arithmetic.polynomial import Polynomial
from checker.files.reading import Malformed
from checker.files.text import of_gms, of_text
from checker.rational import Range, Rational, RationalCertificate, inverse
from checker.result import NotProved

INF = math.inf


def terms(p: Polynomial) -> dict:
    return {word: value for word, value in p.coefficients().items() if value}


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("2*x^2 - 3*x*y + 1/4", {(1, 1): 2, (1, 2): -3, (): 0.25}),
        ("-x^2", {(1, 1): -1}),
        ("-(x - y)^2", {(1, 1): -1, (1, 2): 2, (2, 2): -1}),
        ("x - y - 1 + 3", {(1,): 1, (2,): -1, (): 2}),
        ("x - -y", {(1,): 1, (2,): 1}),
        ("x*y/4/2", {(1, 2): 0.125}),
        ("x**3 * y**0", {(1, 1, 1): 1}),
        ("sqr(x + 2)", {(1, 1): 1, (1,): 4, (): 4}),
        ("1e-3*x + .5*y", {(1,): Fraction(1e-3), (2,): 0.5}),
        ("x + 1/3", {(1,): 1, (): Fraction(1 / 3)}),
        ("- 2*x + 3*y", {(1,): -2, (2,): 3}),
        ("X + y", {(1,): 1, (2,): 1}),
    ],
)
def test_expressions_are_multiplied_out(source, wanted):
    source = source if "y" in source else source + " + 0*y"
    assert terms(of_text(f"min {source}").objective) == wanted
    negative = of_text(f"max {source}")
    assert terms(negative.objective) == {word: -value for word, value in wanted.items()}
    assert negative.sense == "max"


@pytest.mark.parametrize(
    "source",
    [
        "x/y",
        "x/3",
        "x/(y + 2)",
        "x/0",
        "x^y",
        "x^0.5",
        "x^101",
        "x^(0-1)",
        "(x",
        "x)",
        "x y",
        "2 x",
        "1e999*x",
        "x+",
        "inf*x",
        "x + nan",
        "x + X",
        "1",
        "x # y",
        "sqr",
    ],
)
def test_what_is_no_polynomial_is_refused(source):
    with pytest.raises(Malformed):
        of_text(f"min {source}")


def test_relations_are_constraints():
    found = of_text("min x; s.t. x >= 1; x <= 2; x == y; 1 <= x*y <= 4; y =g= 3; y =l= 5; y = 4")
    rows = [(c.kind, terms(c.polynomial)) for c in found.constraints]
    assert rows == [
        ("NONNEGATIVE", {(1,): 1, (): -1}),
        ("NONNEGATIVE", {(1,): -1, (): 2}),
        ("ZERO", {(1,): 1, (2,): -1}),
        ("NONNEGATIVE", {(1, 2): 1, (): -1}),
        ("NONNEGATIVE", {(1, 2): -1, (): 4}),
        ("NONNEGATIVE", {(2,): 1, (): -3}),
        ("NONNEGATIVE", {(2,): -1, (): 5}),
        ("ZERO", {(2,): 1, (): -4}),
    ]
    assert (found.lower, found.upper) == ([-INF] * 2, [INF] * 2)
    assert of_text("min x10 + x2 + x1").names == ["x1", "x2", "x10"]
    for wrong in ("min x; min y", "s.t. x >= 0", "min x; s.t. x + 1"):
        with pytest.raises(Malformed):
            of_text(wrong)


GMS = """* a comment; with a statement
Variables x, y, z, obj;
Positive Variables y;
Binary Variables z;
Equations e1, e2;
e1.. obj =E= x - 2*y + z;
e2.. x*y =G= 1;
x.lo = -3; x.up = 1e10; y.up = 4;
Model m /all/;
Solve m using nlp minimizing obj;
"""


def test_statements_of_gams():
    found = of_gms(GMS)
    assert (found.names, found.sense) == (["x", "y", "z"], "min")
    assert (found.lower, found.upper) == ([-3, 0, 0], [INF, 4, 1])
    assert terms(found.objective) == {(1,): 1, (2,): -2, (3,): 1}
    rows = [(c.kind, terms(c.polynomial)) for c in found.constraints]
    assert rows == [
        ("NONNEGATIVE", {(1, 2): 1, (): -1}),
        ("ZERO", {(3,): -1, (3, 3): 1}),
    ]
    largest = of_gms(GMS.replace("minimizing", "maximising"))
    assert terms(largest.objective) == {(1,): -1, (2,): 2, (3,): -1}
    fixed = of_gms(GMS.replace("y.up = 4", "y.fx = 4"))
    assert (fixed.lower[1], fixed.upper[1]) == (4, 4)
    minus = of_gms(GMS.replace("obj =E= x - 2*y + z", "x - 2*y + z - obj =E= 0"))
    assert terms(minus.objective) == terms(found.objective)
    above = of_gms(GMS.replace("obj =E=", "obj =G="))  # minimised: equal at the least
    assert terms(above.objective) == terms(found.objective)
    negative = of_gms(GMS.replace("Positive", "Negative").replace("y.up = 4", "y.lo = -4"))
    assert (negative.lower[1], negative.upper[1]) == (-4, 0)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("obj =E=", "obj =L="),
        ("obj =E= x", "2*obj =E= x"),
        ("obj =E= x", "obj*x =E= x"),
        ("obj =E= x", "obj + obj*x =E= x"),
        ("x*y =G= 1", "x*y + obj =G= 1"),
        ("y.up = 4", "obj.up = 4"),
        ("Positive Variables y", "Positive Variables obj"),
        ("Positive Variables y", "Integer Variables y"),
        ("Model m /all/", "Model m /e1/"),
        ("minimizing obj;", "minimizing obj; y.up = 2;"),
        ("e2.. x*y =G= 1", "e1.. x*y =G= 1"),
        ("x.lo = -3;", "e2.. x =G= 0; x.lo = -3;"),
        ("y.up = 4", "y.range = 4"),
    ],
)
def test_statements_that_say_something_else_are_refused(before, after):
    assert GMS.count(before) == 1
    with pytest.raises(Malformed):
        of_gms(GMS.replace(before, after))


# ---- ratios -------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [3.0, 7.0, 0.1, 1e-300, 1e300, 5e-324, 0.5])
def test_reciprocals_are_rounded_outwards(value):
    low, high, exact = inverse(value, -INF), inverse(value, INF), 1 / Fraction(value)
    assert low <= exact <= high
    assert high == INF or high - low <= exact * Fraction(1, 2**51)


def test_ranges_of_reciprocals():
    assert Range(1, Fraction(2), Fraction(4)).reciprocal() == (0.25, 0.5)
    assert Range(-1, Fraction(2), Fraction(4)).reciprocal() == (-0.5, -0.25)
    assert Range(1, Fraction(2), INF).reciprocal() == (0, 0.5)
    assert Range(-1, Fraction(2), INF).reciprocal() == (-0.5, 0)


@pytest.mark.parametrize(
    ("value", "side", "most", "part"),
    [
        (2, 1, 8, Fraction(2, 8)),  # p - 3 q >= 2 for 4 <= q <= 8: p / q >= 3 + 2 / 8
        (2, 1, INF, 0),
        (-2, 1, 8, -Fraction(2, 4)),
        (-2, 1, INF, -Fraction(2, 4)),
        (2, -1, 8, Fraction(2, 4)),  # p - 3 q <= 2
        (2, -1, INF, Fraction(2, 4)),
        (-2, -1, 8, -Fraction(2, 8)),
        (-2, -1, INF, 0),
    ],
)
def test_levels_translate_bounds(value, side, most, part):
    """Of 10 + p / q at the level 3 of p / q."""
    proof = RationalCertificate.__new__(RationalCertificate)
    ratio = poly({(): 1}), poly({(1,): 1})
    proof.about = SimpleNamespace(
        constant=10, place=lambda _: 0, objective=Rational(poly({(): 10}), [ratio])
    )
    proof.level, proof.ranges = 3, [Range(1, Fraction(4), most)]
    assert proof.translated(value, side) == 10 + 3 + part
    assert proof.translated(INF, side) == INF
    proof.level = None
    assert proof.translated(value, side) == value


def stated(bound):
    part = {"steps": [], "argument": None, "empty": False, "branch": None, "children": []}
    return [{"fingerprint": "", "bound": bound, "cutoff": None, "parts": [part]}]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("below", "above", "least", "most"),
    [
        (1.0, -2.0, 1, 2),
        (0.5, None, 0.5, INF),
        (0.5, -3.0, 0.5, 3),
        (1.0, -1.5, 1, INF),  # 1.5 is no upper bound of x
        (1.5, -2.0, None, None),  # nor a lower one
        (0.0, -2.0, None, None),  # says nothing of the sign
    ],
)
def test_sizes_of_denominators_are_proved(sign, below, above, least, most):
    """The denominator x or -x on [1, 2], where interval arithmetic is enough."""
    proof = RationalCertificate.__new__(RationalCertificate)
    proof.about = SimpleNamespace(base=problem(1, {(): 0}, low=1, high=2))
    above = None if above is None else stated(above)
    found = {"sign": sign, "below": stated(below), "above": above}
    q = poly({(1,): sign})
    if least is None:
        with pytest.raises(NotProved, match="sign of the denominator"):
            proof.range_of(found, q, "range")
    else:
        assert proof.range_of(found, q, "range") == Range(sign, least, most)
        with pytest.raises(NotProved):
            proof.range_of(found | {"sign": -sign}, q, "range")
