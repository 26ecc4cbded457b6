"""Identities, duals and Gram matrices of the second checker, by hand."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import pytest
from hand_made_proofs import (
    INF,
    NO_PRODUCTS,
    PSD,
    array,
    free,
    group,
    identity,
    poly,
    scaling,
    text,
)

from checker.arithmetic.polynomial import Polynomial
from checker.certificates.exact_dual import ExactDual
from checker.certificates.gram import ExactGram
from checker.certificates.identity import Generators, Group, LinearDual, Row, Scaling, cost
from checker.files.reading import Constraint, Malformed


def test_scalings_hold_boxes_that_lie_in_theirs():
    """1 + 2 [-1, 1] = [-1, 3] and 2 + 4 [0, inf)."""
    found = scaling(2, centre=array("f8", 1.0, 2.0), scale=array("f8", 2.0, 4.0))
    found |= {"boxed": array("b1", True, False), "side": array("i8", 0, 1)}
    one = Scaling(found, 2, "scaling")
    tiny = Fraction(1, 10**30)
    assert one.holds([(-1, 3), (2, INF)])
    assert one.holds([(0, 0), (5, 6)])
    for pair in ((-1 - tiny, 3), (-1, 3 + tiny), (-INF, 3), (-1, INF)):
        assert not one.holds([pair, (2, INF)])
    assert not one.holds([(-1, 3), (2 - tiny, INF)])


def test_generators_are_rows_bounds_and_products():
    """x1 = 1 + 2 t1 with t1 in [-1/2, 1], x2 = t2 >= 0, and x3 = -3."""
    found = free(3, centre=array("f8", 1.0, 0.0, -3.0), scale=array("f8", 2.0, 1.0, 1.0))
    limits = [array("f8", -0.5, 0.0, 0.0), array("f8", *text([1.0, INF, 0.0]))]
    argument = LinearDual(
        {
            "scaling": found | {"ends": limits},
            "generator": array("i4"),
            "word": {"type": "i4", "shape": [0, 0], "data": []},
            "value": array("f8"),
            "owner": array("i4"),
            "products": array("i8", [1, 6], [6, 12]),
        },
        3,
        "dual",
    ).given
    rows = [Row(poly({(1, 2): 1, (): 5}), False), Row(poly({(3,): 1}), True)]
    made = Generators(rows, argument)
    a, b, c = Fraction(1, 3), Fraction(7), Fraction(2)
    x = [1 + 2 * a, b, c - 3]
    wanted = [1, x[0] * x[1] + 5, x[2]]
    wanted += [(a + Fraction(1, 2)) * (1 - a), 0, 0]  # (t - low) (high - t), where both are there
    wanted += [a + Fraction(1, 2), b, 0]
    wanted += [1 - a, 0, 0]
    wanted += [wanted[1] * wanted[6], wanted[6] * wanted[1] * wanted[6]]
    assert made.count == len(wanted) == 14
    assert [made[k].at([a, b, c]) for k in range(14)] == wanted
    assert [k for k in range(14) if made.equality(k)] == [2]
    signs = {k: made.sign_of(k) for k in range(14) if made.sign_of(k) is not None}
    assert signs == {0: (), 7: (2,)}  # t2 runs from 0 to infinity


def test_generators_of_free_variables_have_signs():
    """t1 >= 0 and t2 <= 0; t3 has no end."""
    found = free(3, side=array("i8", 1, -1, 0))
    given = identity(3, [], scaling=found, products=array("i8", [4, 8], [4, 8], [4, 8]))
    made = Generators([], given)
    assert {k: made.sign_of(k) for k in range(13)} == {
        **dict.fromkeys(range(13)),
        0: (),
        4: (1,),
        8: (2,),
    }
    assert [made[k].at([Fraction(2), Fraction(-3), Fraction(5)]) for k in (4, 8)] == [2, 3]


def test_remainders_cost_their_largest_values():
    """2 x, -3 x^2, 5 y^2, -x y and others on [-1, 1]^2, with the sign of what lowers the bound."""
    terms = {(1,): 2, (1, 1): -3, (2, 2): 5, (1, 2): -1, (1, 1, 2, 2): -4, (1, 1, 1): -7}
    terms |= {(1, 1, 2): 6}
    assert cost({word: Fraction(c) for word, c in terms.items()}) == 2 + 3 + 0 + 1 + 4 + 7 + 6


def test_multipliers_are_squares_and_the_floor():
    found = Group(group([0], [[[0], [1]]], [[[1.0, 0.0], [2.0, 3.0]]], 0.5), 1, "group")
    gram = found.gram(0)
    assert gram.coefficients() == {(0, 0): 1.5, (1, 0): 2, (1, 1): 13.5}


@pytest.mark.parametrize(
    "changes",
    [
        {"generator": array("i4", 0, 1)},
        {"basis": array("i4", [[0]])},
        {"floor": -0.5},
        {
            "basis": {"type": "i4", "shape": [1, 0, 1], "data": []},
            "values": {"type": "f8", "shape": [1, 0, 1], "data": []},
        },
        {"values": array("f8", [1.0, 2.0]), "place": array("i4", [0, 1])},
        {"place": array("i4", [0])},
    ],
    ids=str,
)
def test_multipliers_that_make_no_sense_are_refused(changes):
    given = group([0], [[[0], [1]]], [[[1.0, 0.0], [2.0, 3.0]]], 0.5)
    Group(given, 1, "group")
    with pytest.raises(Malformed):
        Group(given | changes, 1, "group")


# ---- identities ---------------------------------------------------------------------------------

SQUARE = group([0], [[[0], [1]]], [[[0.5], [-1.0]]])  # (x - 1/2)^2 = x^2 - x + 1/4


@pytest.mark.parametrize(
    ("rest", "bound"),
    [
        ({}, -0.25),
        ({(): 3.0}, 2.75),
        ({(1, 1, 1): 0.5}, -0.75),
        ({(1, 1): 0.5}, -0.25),
        ({(1, 1): -0.5}, -0.75),
    ],
)
def test_an_identity_bounds_by_its_remainder(rest, bound):
    terms = {(1, 1): 1.0, (1,): -1.0}
    terms |= {word: terms.get(word, 0) + c for word, c in rest.items()}
    assert identity(1, [SQUARE]).prove([], [], poly(terms)).bound == bound


def test_multipliers_multiply_rows():
    """x^2 - 1 >= 0 gives 2 x^2 >= 2; as an equation it gives -3 x^2 >= -3 and x^3 = x."""
    row = poly({(1, 1): 1, (): -1})
    twice = identity(1, [group([1], [[[0]]], [[[math.sqrt(4)]]])], scaling=free(1))
    assert twice.prove([Row(row, False)], [], poly({(1, 1): 4})).bound == 4
    equal = group([1], [[[0], [1]]], [[-3.0, 0.5]])
    found = identity(1, [equal], scaling=free(1))
    objective = poly({(1, 1): -3, (1, 1, 1): 0.5, (1,): -0.5})
    assert found.prove([Row(row, True)], [], objective).bound == -3
    with pytest.raises(Malformed, match="free"):
        found.prove([Row(row, False)], [], objective)
    both = identity(1, [group([1], [[[0]]], [[[1.0]]]), SQUARE], scaling=free(1))
    assert both.prove([Row(row, False)], [], poly({(1, 1): 2, (1,): -1})).bound == 0.75
    beyond = identity(1, [group([9], [[[0]]], [[[1.0]]])])
    with pytest.raises(Malformed, match="generator"):
        beyond.prove([Row(row, False)], [], objective)


CONE = Constraint("SECOND_ORDER", poly({}), [poly({(1,): 1}), poly({(): 3}), poly({(): 4})])


def test_multipliers_of_matrices_multiply_their_entries():
    """<[1 -1; -1 1], [x 1; 1 y]> = x + y - 2."""
    given = group([1], [[[0], [0]]], [[[1.0], [-1.0]]], place=[[0, 1]])
    found = identity(2, [given], scaling=free(2))
    rows = [Row(poly({}), False)]
    assert found.prove(rows, [PSD], poly({(1,): 1, (2,): 1})).bound == 2
    assert found.prove(rows, [PSD], poly({(1,): 1, (2,): 2})).bound == -INF
    shifted = free(2, centre=array("f8", 1.0, 5.0), scale=array("f8", 2.0, 0.5))
    found = identity(2, [given], scaling=shifted)
    assert found.prove(rows, [PSD], poly({(1,): 1, (2,): 1})).bound == 2
    corner = group([1], [[[0]]], [[[1.0]]], place=[[1]])
    assert identity(2, [corner], scaling=free(2)).prove(rows, [PSD], poly({(2,): 1})).bound == 0
    for number, place in ((1, [0, 2]), (2, [0, 1])):
        wrong = group([number], [[[0], [0]]], [[[1.0], [-1.0]]], place=[[*place]])
        with pytest.raises(Malformed):
            identity(2, [wrong], scaling=free(2)).prove(rows, [PSD], poly({(1,): 1}))


def test_multipliers_of_cones_multiply_their_arrow():
    """(5, -3, -4) times (x, 3, 4) by an arrow: 5 x - 25, twice.

    The arrow [x 3 4; 3 x 0; 4 0 x] times v v' + w w' + ..., with entries (2, 3) that count for
    nothing, as the arrow is zero there.
    """
    given = group([1], [[[0], [0], [0]]], [[[5.0], [-3.0], [-4.0]]], place=[[0, 1, 2]])
    found = identity(1, [given], scaling=free(1))
    bound = found.prove([Row(poly({(1,): 1}), False)], [CONE], poly({(1,): 50})).bound
    assert bound == 2 * (15 * 3 + 20 * 4)


@pytest.mark.parametrize(
    ("changes", "least"),
    [({}, -1.0), ({"ends": [array("f8", 0.25), array("f8", 1.0)]}, 0.25)],
)
def test_priced_monomials_have_the_least_value_of_the_box(changes, least):
    priced = {"words": array("i4", [1]), "values": array("f8", 2.0)}
    found = identity(1, [], priced=priced, scaling=scaling(1, **changes))
    assert found.prove([], [], poly({(1,): 2})).bound == 2 * least
    assert found.prove([], [], poly({(1,): 2.5})).bound == 2 * least - 0.5
    more = {"words": array("i4", [1, 1], [0, 1]), "values": array("f8", 1.0, 2.0)}
    two = identity(1, [], priced=more, scaling=scaling(1, **changes))
    assert two.prove([], [], poly({(1,): 2, (1, 1): 1})).bound == 2 * least + max(least, 0) ** 2
    open_ = identity(1, [], priced=priced, scaling=free(1))
    assert open_.prove([], [], poly({(1,): 2})).bound == -INF


@pytest.mark.parametrize(
    ("rest", "left"),
    [
        ({}, 0.5),
        ({(1,): 0.5}, 0.25),  # half of it in row and column of the matrix
        ({(1,): -1.0}, 0.0),
        ({(1,): 1.0001}, None),
        ({(1, 1): -0.25}, 0.25),
        ({(1, 1): 0.25}, 0.25),
        ({(1, 1): 0.5001}, None),
        ({(1,): 0.5, (1, 1): 0.25}, 0.0),  # both in the second row
        ({(1,): 0.5, (1, 1): 0.2501}, None),
        ({(1, 1, 1): 1e-9}, None),
    ],
)
def test_floors_pay_for_monomials_without_a_range(rest, left):
    """(x - 1)^2 + (1 + x^2) / 2 = 3 x^2 / 2 - 2 x + 3 / 2, and something more."""
    given = group([0], [[[0], [1]]], [[[1.0], [-1.0]]], 0.5)
    terms = {(1, 1): 1.5, (1,): -2.0}
    terms |= {word: terms.get(word, 0) + c for word, c in rest.items()}
    proved = identity(1, [given], scaling=free(1)).prove([], [], poly(terms))
    if left is None:
        assert proved.bound == -INF
    else:
        assert proved.bound == -1.5
        assert abs(proved.floor - Fraction(left)) < 1e-15


@pytest.mark.parametrize(("slope", "bound"), [(0.5, -0.5), (1.0, -INF)])
def test_floors_pay_for_whole_rows(slope, bound):
    """(1 + x^2 + y^2) / 2 + slope (x + y) has both slopes in the first row; at 1 it reaches -1."""
    given = group([0], [[[0, 0], [0, 1], [0, 2]]], [[[0.0]] * 3], 0.5)
    terms = {(1, 1): 0.5, (2, 2): 0.5, (1,): slope, (2,): slope}
    assert identity(2, [given], scaling=free(2)).prove([], [], poly(terms)).bound == bound


def test_the_least_floor_is_what_all_blocks_keep():
    groups = [group([0], [[[k]]], [[[0.0]]], floor) for k, floor in ((0, 0.5), (1, 0.25))]
    found = identity(1, groups, scaling=free(1)).prove([], [], poly({(1, 1): 0.25}))
    assert (found.bound, found.floor) == (-0.5, 0.25)


def test_floors_of_bounds_pay_for_odd_monomials():
    """For x >= 0 the multiplier floor * 1 of x pays for c x with |c| at most the floor."""
    given = group([2], [[[0]]], [[[0.0]]], 0.5)
    found = identity(1, [given], scaling=free(1, side=array("i8", 1)))
    assert found.prove([], [], poly({(1,): 0.5})).bound == 0
    assert found.prove([], [], poly({(1,): 1.0})).bound == 0
    assert found.prove([], [], poly({(1,): 1.0625})).bound == -INF
    none = identity(1, [group([1], [[[0]]], [[[0.0]]], 0.5)], scaling=free(1))
    row = [Row(poly({(1,): 1}), False)]
    assert none.prove(row, [], poly({(1,): 0.75})).bound == -INF  # a row is no sign


def test_boxed_and_free_variables_are_told_apart():
    """x in [-1, 1] costs 1/4 |x|; x y with y free costs what no floor pays."""
    given = scaling(2, boxed=array("b1", True, False))
    found = identity(2, [], scaling=given)
    assert found.prove([], [], poly({(1,): 0.25})).bound == -0.25
    assert found.prove([], [], poly({(1, 2): 0.25})).bound == -INF


# ---- duals --------------------------------------------------------------------------------------


def dual(n, terms, **changes):
    numbers, words, values, owners = zip(*terms, strict=True)
    found = {"scaling": changes.pop("scaling", scaling(n)), "products": NO_PRODUCTS}
    found |= {"generator": array("i4", *numbers), "word": array("i4", *words)}
    found |= {"value": array("f8", *values), "owner": array("i4", *owners)}
    return LinearDual(found, n, "dual")


def test_linear_duals_bound_several_objectives():
    """x + y >= 1 and x == 2 y on [-1, 1]^2."""
    rows = [Row(poly({(1,): 1, (2,): 1, (): -1}), False), Row(poly({(1,): 1, (2,): -2}), True)]
    asked = [poly({(1,): 2, (2,): 2}), poly({(1,): 1}), poly({(1,): -1, (2,): -1})]
    terms = [(1, [0, 0], 2.0, 0), (2, [0, 0], 1.0, 1), (1, [0, 0], -1.0, 2)]
    assert dual(2, terms).prove(rows, asked) == [2, -2, -2]
    loose = dual(2, terms, scaling=free(2))
    assert loose.prove(rows, asked) == [2, -INF, -INF]
    half = dual(2, [(2, [0, 0], 0.0, 0)], scaling=scaling(2, boxed=array("b1", True, False)))
    assert half.prove(rows, [poly({(1,): 2}), poly({(1, 2): 1})]) == [-2, -INF]
    minus = dual(2, [(2, [0, 0], -1.0, 0)])
    assert minus.prove(rows, [poly({(1,): -1, (2,): 2})]) == [0]


def test_monomials_multiply_equations_only():
    """x == 2 y gives x y = 2 y^2."""
    rows = [Row(poly({(1,): 1}), False), Row(poly({(1,): 1, (2,): -2}), True)]
    asked = [poly({(1, 2): 1, (2, 2): -2})]
    assert dual(2, [(2, [0, 2], 1.0, 0)], scaling=free(2)).prove(rows, asked) == [0]
    for term in ((1, [0, 2], 1.0, 0), (7, [0, 0], 1.0, 1), (9, [0, 0], 1.0, 0)):
        with pytest.raises(Malformed):
            dual(2, [term]).prove(rows, asked)


def exact_dual(low, high, *terms, gram=None):
    rows, words, values = zip(*terms, strict=True)
    found = {"lower": array("f8", *text(low)), "upper": array("f8", *text(high)), "gram": gram}
    found |= {"row": array("i8", *rows), "word": array("i4", *words), "value": list(values)}
    return ExactDual(found, len(low), "dual")


def test_exact_duals_hold_within_their_bounds():
    found = exact_dual([0.0, -INF], [INF, 2.0], (0, [0], "1"))
    assert found.holds([(0, 5), (-INF, 2)])
    assert not found.holds([(Fraction(-1, 10**30), 5), (-INF, 2)])
    assert not found.holds([(0, 5), (-INF, 2 + Fraction(1, 10**30))])


def test_exact_duals_multiply_rows_and_both_bounds():
    """3 x + y >= 1, x y == 2 and 1 <= x <= 5, y <= 7: multipliers cancel all but a constant."""
    rows = [Row(poly({(1,): 3, (2,): 1, (): -1}), False), Row(poly({(1, 2): 1, (): -2}), True)]
    low, high = [1.0, -INF], [5.0, 7.0]
    one = [(0, [0], "1/3"), (2, [0], "2")]
    assert exact_dual(low, high, *one).prove(rows, poly({(1,): 3, (2,): 0})) == -INF
    objective = Polynomial.of([(1,), (2,)], [3.0, 0.25])
    terms = [(0, [0], "1/4"), (2, [0], "9/4")]
    assert exact_dual(low, high, *terms).prove(rows, objective) == Fraction(1, 4) + Fraction(9, 4)
    upper = [(4, [0], "2"), (5, [0], "1/2")]
    assert exact_dual(low, high, *upper).prove(rows, poly({(1,): -2, (2,): -0.5})) == -10 - 3.5
    words = [(1, [1], "-3"), (2, [0], "1")]
    assert exact_dual(low, high, *words).prove(rows, poly({(1, 1, 2): -3, (1,): 7})) == 1
    for term in ((0, [1], "1"), (3, [0], "1"), (4, [0], "-1"), (6, [0], "1")):
        with pytest.raises(Malformed):
            exact_dual(low, high, term).prove(rows, objective)


def test_exact_duals_leave_a_sum_of_squares():
    """x^2 - 2 x + (x - 1) = (x - 1/2)^2 - 5/4, so that x^2 - 2 x >= -5/4 for x <= 1."""
    gram = {"basis": array("i4", [0], [1]), "first": array("i8", 0, 1)}
    gram |= {"second": array("i8", 1, 1), "value": array("f8", 0.0, 0.0)}
    found = exact_dual([-INF], [1.0], (1, [0], "1"), gram=gram)
    assert found.prove([], poly({(1, 1): 1, (1,): -2})) == Fraction(-5, 4)
    assert found.prove([], poly({(1, 1): -1, (1,): -2})) == -INF


# ---- Gram matrices ------------------------------------------------------------------------------


def gram(basis, *entries):
    first, second, values = zip(*entries, strict=True)
    found = {"basis": array("i4", *basis), "value": array("f8", *values)}
    found |= {"first": array("i8", *first), "second": array("i8", *second)}
    return ExactGram(found, max(map(max, basis)), "gram")


FORMS = list(itertools.product((1, 2), (-1, 0, 3), (2, 4), (-1, 2), (0, 3)))


@pytest.mark.parametrize("a, b, c, d, e", FORMS)
def test_exact_grams_bound_quadratic_forms(a, b, c, d, e):
    """a x^2 + 2 b x y + c y^2 + 2 d x + 2 e y + 5 is least where the gradient is zero."""
    basis = [[0, 0], [0, 1], [0, 2]]
    found = gram(basis, *[(i, j, 0.0) for i in range(3) for j in range(i + 1) if i])
    terms = {(1, 1): a, (1, 2): 2 * b, (2, 2): c, (1,): 2 * d, (2,): 2 * e, (): 5}
    bound = found.prove(poly(terms))
    det = a * c - b * b
    if det > 0:
        x, y = Fraction(b * e - c * d, det), Fraction(b * d - a * e, det)
        assert bound == a * x * x + 2 * b * x * y + c * y * y + 2 * d * x + 2 * e * y + 5
    elif det < 0:
        assert bound == -INF


@pytest.mark.parametrize(("inner", "bound"), [(0.0, 0), (2.0, -3), (-0.5, -INF)])
def test_entries_of_a_gram_matrix_share_monomials(inner, bound):
    """x^4 - 2 x^2 + 1 with a share of x^2 in x x: what x^2 1 keeps is (-2 - inner) / 2."""
    entries = [(0, 1, 0.0), (0, 2, 0.0), (1, 1, inner), (1, 2, 0.0), (2, 2, 0.0)]
    found = gram([[0, 0], [0, 1], [1, 1]], *entries)
    assert found.prove(poly({(1, 1, 1, 1): 1, (1, 1): -2, (): 1})) == bound
    assert found.prove(poly({(1,) * 4: 1, (1, 1): -2, (1,) * 5: 1e-9})) == -INF


def test_entries_beside_the_diagonal_stand_twice():
    """x^2 y^2 as (x y)^2 with a share 2 q in x^2 y^2: [1 .; . q] is semidefinite for q >= 0."""
    basis = [[0, 0], [1, 1], [2, 2], [1, 2]]
    for share, bound in ((0.25, 0), (0.5, 0), (0.75, -INF)):
        entries = [(3, 3, 0.0), (1, 2, share), (1, 1, 0.0), (2, 2, 0.0)]
        found = gram(basis, *entries)
        terms = {(1,) * 4: 1, (2,) * 4: 1, (1, 1, 2, 2): 1}
        assert found.prove(poly(terms)) == bound
    with pytest.raises(Malformed):
        gram(basis, (0, 4, 0.0))
    for basis in ([[0, 1], [0, 0]], [[0, 0], [0, 1], [0, 0]]):
        with pytest.raises(Malformed):
            gram(basis, (0, 1, 0.0))
    separate = gram([[0], [1], [2], [3]], *[(k, j, 0.0) for k in (1, 2, 3) for j in (0, k)])
    terms = {(k,) * n: c for k in (1, 2, 3) for n, c in ((2, 1), (1, -2 * k))}
    assert separate.prove(poly(terms)) == -1 - 4 - 9
