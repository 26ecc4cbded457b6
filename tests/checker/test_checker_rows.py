"""Boxes from rows of a record, one by one and in products of parameters, by hand."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import pytest

from checker.arithmetic import interval as iv
from checker.certificates.left_inverse import contracts
from checker.files import reading
from checker.records.box import walk
from checker.records.linear_rows import Regression, by_tree, combined, given_row
from checker.records.parameter_box import by_products, settle, settle_denominators, total
from checker.records.structure import Record, Structure
from checker.result import NotProved

INF = math.inf


# ---- rows one by one, by hand -------------------------------------------------------------------


def small(columns):
    """y(k) + a y(k-1) = b u(k) at k = 1: readings 4, 2 and u = 3; noise .1, .2, errors .5."""
    table = {"na": [[1]], "nb": [[1]], "nk": [[0]], "form": "auto", "initial": "free"}
    stated = {"u": [[1.0, 3.0]], "y": [[4.0, 2.0]], "starts": [0], "ranges": {"u": None, "y": None}}
    noise = {"output": [[0.125] * 2], "input": [[0.25] * 2], "equation": [[0.5] * 2]}
    record = Record({"record": stated, "noise": noise})
    record.letters = {("eta", 1, 0): 3, ("eta", 1, 1): 4, ("xi", 1, 1): 5}
    wide = [Fraction(1, 8), Fraction(1, 8), Fraction(1, 4)]
    problem = SimpleNamespace(lower=[-INF] * 2 + [-v for v in wide], upper=[INF] * 2 + wide)
    made = Structure(table | {"common_denominator": False, "offset": False}, 1, 1)
    about = SimpleNamespace(
        names=["a1", "b0"], record=record, structure=made, problem=problem, units=[Fraction(1)] * 5
    )
    return Regression(about, columns)


def test_noise_at_its_largest_effect():
    """|2 + 4 a - 3 b| <= .125 + .5 + .125 |a| + .25 |b|, by hand."""
    centre, radius = small([[(1,)], [(2,)]]).row(1, 1)
    assert centre == [4, -3, 2]
    assert radius == [Fraction(1, 8), Fraction(1, 4), Fraction(5, 8)]


def test_rows_need_a_column_for_each_product_and_one_signal_in_each():
    with pytest.raises(reading.Malformed, match="no column"):
        small([[(1,)]]).row(1, 1)
    with pytest.raises(NotProved, match="different signals"):
        small([[(1,), (2,)]]).row(1, 1)


@pytest.mark.parametrize(
    ("slope", "constant", "good"),
    [(-3.875, -1.375, True), (-3.875, -1.5, False), (-4.0, -1.25, True), (-4.0, -1.375, False)],
)
def test_linear_rows_follow_where_their_least_value_does(slope, constant, good):
    """For 0 <= a <= 1, b = 0 the row says .625 + .125 a - 2 - 4 a >= 0: no less, at both ends."""
    rows, part = small([[(1,)], [(2,)]]), [[Fraction(0)] * 2, [Fraction(1), Fraction(0)]]
    asked = [1, 1, 1, [slope, 0.0, constant]]
    if good:
        assert given_row(asked, rows, part) == [slope, 0, constant]
        return
    with pytest.raises(NotProved):
        given_row(asked, rows, part)


def test_signs_of_rows_are_whole_numbers():
    """1.0 times a fraction is a float: the constant is too small by less than floats show."""
    rows, part = small([[(1,)], [(2,)]]), [[Fraction(0)] * 2, [Fraction(1), Fraction(0)]]
    low = math.nextafter(-1.375, -INF)
    with pytest.raises(NotProved):
        given_row([1, 1, 1, [Fraction(v) for v in (-3.875, 0.0, low)]], rows, part)
    for sign in (1.0, True, 2):
        node = {"children": [], "split": -1, "rows": [[1, 1, sign, [-3.875, 0.0, low]]]}
        with pytest.raises(reading.Malformed, match=r"box.nodes\[0\].rows\[0\]"):
            by_tree({"nodes": [node | {"bounds": []}]}, rows, part)


def test_multipliers_of_linear_rows():
    """x + y >= 1 and x - y >= 2 give x >= 3/2; with x <= 1 nothing is left."""
    rows = [[Fraction(v) for v in row] for row in ([1, 1, -1], [1, -1, -2], [-1, 0, 1])]
    half = [[0, Fraction(1, 2)], [1, Fraction(1, 2)]]
    assert combined(rows, half, (0, 0)) == Fraction(3, 2)
    assert combined(rows, [*half, [2, Fraction(1)]], None) == INF
    others = [[0, Fraction(-1)], [1, Fraction(2)]]
    for pairs, goal in ((half, (1, 0)), (half, None), (others, (0, 0))):
        with pytest.raises(NotProved):
            combined(rows, pairs, goal)
    with pytest.raises(NotProved, match="negative"):
        combined(rows, [[0, Fraction(1, 2)], [1, Fraction(-1, 2)]], (1, 0))
    with pytest.raises(reading.Malformed):
        combined([[Fraction(1), Fraction(0), INF]], [[0, Fraction(1)]], (0, 0))


@pytest.mark.parametrize(("radius", "good"), [(1.0, False), (1.0009765625, True)])
def test_left_inverses_of_intervals(radius, good):
    """-1 + C x = 0 for C in [1/2, 3/2], around 1: G = 1/2 and d = 1/2 need more than 1."""
    table = [[(iv.below(0.5), iv.above(1.5)), (iv.below(-1), iv.above(-1))]]
    assert contracts([[1.0]], table, [1.0], [radius]) is good


# ---- products ----


def grid(*pairs):
    return [(iv.below(a), iv.above(b)) for a, b in pairs]


def near(pair, low, high):
    """Whether an interval contains [low, high] and is hardly larger."""
    a, b = (iv.exact(end) for end in pair)
    return a <= low and high <= b and low - a < Fraction(1, 10**300) > b - high


def test_products_bound_their_factors():
    """2 <= a b <= 6 with 1 <= a <= 2 bounds b by 1 and 6, and then a by 1/3: nothing new."""
    box = grid((1, 2), (0, 10))
    settle([(1, 2)], *grid((2, 6)), box)
    assert near(box[1], 1, 6) and near(box[0], 1, 2)


def test_sums_of_products_bound_each_of_them():
    """3 <= a + c <= 4 with 1 <= a <= 2 gives 1 <= c <= 3; a + a c over it is at most 8."""
    box = grid((1, 2), (-10, 10))
    settle([(1,), (2,)], *grid((3, 4)), box)
    assert near(box[1], 1, 3)
    assert near(total([(1,), (1, 2)], box), 2, 8)


def test_a_factor_that_all_products_share_is_divided_by_their_other_factors():
    """6 <= c + c a + c a b <= 12 with 1 <= a <= 2, 0 <= b <= 1: c in 6 / 5 to 12 / 2."""
    box = grid((1, 2), (0, 1), (-1000, 1000))
    settle([(3,), (1, 3), (1, 2, 3)], *grid((6, 12)), box)
    assert near(box[2], Fraction(6, 5), 6) and near(box[0], 1, 2) and near(box[1], 0, 1)


def test_columns_bound_what_they_are_part_of():
    """c + c a + c a' + c a a' = 3 with a + a' in [-1, 0], a a' in [1, 2]: c in [1, 3]."""
    column, box = [(3,), (1, 3), (2, 3), (1, 2, 3)], grid((-9, 9), (-9, 9), (-999, 999))
    pairs = list(zip([column, [(1,), (2,)], [(1, 2)]], grid((3, 3), (-1, 0), (1, 2)), strict=True))
    settle(*pairs[0], box, pairs)
    assert near(box[2], 1, 3)


def test_denominators_at_one_are_a_product():
    """c (1 + a) (1 + a') = 2 with a, a' in [-3/4, 1]: c in [1/2, 32]."""
    box = grid((Fraction(-3, 4), 1), (Fraction(-3, 4), 1), (-999, 999))
    column, known = [(3,), (1, 3), (2, 3), (1, 2, 3)], grid((2, 2))[0]
    settle(column, known, list(box), [(column, known)])
    settle(column, known, box, [(column, known)], [[[1], [2]]])
    assert near(box[2], Fraction(1, 2), 32)


def test_coefficients_of_denominators_by_those_of_their_product():
    """Orders 2 and 1: sqrt(1 + 9 + 25 + 9) for a2 and a', twice for a1; nothing without one."""
    columns = [[(1,), (3,)], [(2,), (1, 3)], [(2, 3)]]
    pairs = list(zip(columns, grid((3, 3), (-5, 1), (3, 3)), strict=True))
    box = [iv.WHOLE] * 3
    settle_denominators([[1, 2], [3]], pairs, box)
    for pair, count in zip(box, (2, 1, 1), strict=True):
        high = iv.exact(pair[1]) / count
        assert -pair[0] == pair[1] and 0 <= high**2 - 44 < Fraction(1, 10**300)
    box = [iv.WHOLE] * 3
    settle_denominators([[1, 2], [3]], pairs[:2], box)
    assert box == [iv.WHOLE] * 3


def test_squares_and_factors_of_some_products_are_not_shared():
    """a^2 + a b = 2 at a = -2, b = 1, and a b + c = 2 at a = 2, b = 1, c = 0: both stay."""
    box = grid((-2, 2), (1, 1))
    settle([(1, 1), (1, 2)], *grid((2, 2)), box)
    assert iv.exact(box[0][0]) <= -2
    box = grid((0, 4), (1, 1), (-1, 3))
    settle([(3,), (1, 2)], *grid((2, 2)), box)
    assert iv.exact(box[2][0]) <= 0 and iv.exact(box[0][1]) >= 3


def test_an_offset_of_the_output_is_multiplied_by_each_denominator():
    """(1 + a) (1 + a') c of two inputs with a pole each; c alone in the direct form."""
    table = {"na": [[1, 1]], "nb": [[1, 1]], "nk": [[1, 1]], "initial": "free"}
    flags = {"common_denominator": False, "offset": True}
    for form, factors in (
        ("direct", [()]),
        ("multiplied", [(), ("a[1,1]1",), ("a[1,2]1",), ("a[1,1]1", "a[1,2]1")]),
        ("lifted", [(), ("a[1,1]1",), ("a[1,2]1",), ("a[1,1]1", "a[1,2]1")]),
    ):
        made = Structure(table | flags | {"form": form}, 2, 1)
        constant = [term for term in made.equation("y1") if not term.signal]
        assert all(term.sign == -1 and not term.lag for term in constant)
        assert sorted(term.parameters for term in constant) == sorted((*f, "c") for f in factors)
    for form in ("multiplied", "lifted"):
        with pytest.raises(reading.Malformed, match="zero"):
            Structure(table | flags | {"form": form, "initial": "zero"}, 2, 1)


@pytest.mark.parametrize("form", ["auto", "partial"])
def test_an_offset_beside_partial_outputs_has_all_factors(form):
    """Eliminated rows hold c (1 + a) (1 + a'), where systems do not begin at rest."""
    table = {"na": [[1, 1]], "nb": [[1, 1]], "nk": [[1, 1]], "form": form}
    flags = {"common_denominator": False, "offset": True}
    made = Structure(table | flags | {"initial": "free"}, 2, 1)
    constant = [set(t.parameters) for t in made.direct(0) if not t.signal]
    a, b = "a[1,1]1", "a[1,2]1"
    assert len(constant) == 4 and all(
        s in constant for s in ({"c"}, {"c", a}, {"c", b}, {"c", a, b})
    )
    with pytest.raises(NotProved, match="at rest"):
        Structure(table | flags | {"initial": "zero"}, 2, 1).direct(0)


def test_a_common_denominator_has_one_order():
    table = {"na": [[1, 2]], "nb": [[1, 1]], "nk": [[1, 1]], "form": "auto", "initial": "free"}
    with pytest.raises(reading.Malformed, match="several orders"):
        Structure(table | {"common_denominator": True, "offset": False}, 2, 1)


def test_a_product_with_a_factor_around_zero_bounds_nothing():
    box = grid((-1, 1), (-10, 10))
    settle([(1, 2)], *grid((2, 6)), box)
    assert near(box[1], -10, 10)


def products(columns, ends):
    """A step of products whose own rows say only what the box says."""
    about = SimpleNamespace(names=["a", "b"], structure=SimpleNamespace(outputs=()))
    step = {"columns": columns, "steps": []}
    return by_products(step, Regression(about, [[(1,)], [(2,)]]), ends)


def test_products_without_rows_leave_the_box():
    ends = [[Fraction(1), -INF], [Fraction(2), INF]]
    assert products([[[0]], [[1]], [[0, 1]]], ends) == ends


@pytest.mark.parametrize("columns", [[[[0]], [[0]]], [[]], [[[]]], [[[2]]], [[[-1]]], [[[True]]]])
def test_columns_that_make_no_sense_are_refused(columns):
    with pytest.raises(reading.Malformed):
        products(columns, [[Fraction(0)] * 2, [Fraction(1)] * 2])


@pytest.mark.parametrize("children", [[1, 4], [3, 4]])
def test_parts_of_a_tree_come_later_and_once(children):
    """Node 2 may not be split in 1, which stands before it, nor in 3, which is a part of 0."""
    nodes = [{"children": c} for c in ([2, 3], [], children, [], [])]
    with pytest.raises(reading.Malformed, match="a node twice, or before"):
        walk(nodes, "box.nodes", [0], lambda _, node, own: [own] * len(node.children))
