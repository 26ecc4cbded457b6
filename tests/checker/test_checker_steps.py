"""Sweeps, steps, trees and quotes of the second checker, by hand."""

from __future__ import annotations

import itertools
from fractions import Fraction

import pytest
from hand_made_proofs import (
    INF,
    NO_PRODUCTS,
    array,
    box_of,
    ends,
    free,
    group,
    poly,
    problem,
)

from checker.arithmetic import interval as iv
from checker.certificates.certificate import Certificates, LeftInverse, Replay, Sublevel, Tightening
from checker.certificates.propagation import Row as BoxRow
from checker.certificates.propagation import Rows
from checker.files.reading import Constraint, Malformed

ROWS = [
    ({(1, 1): 1, (1,): -2, (2,): 1}, (-1, 3)),
    ({(1, 1): -1, (1,): 3, (2, 3): 2}, (0, INF)),
    ({(1, 2): 1, (3, 3): -2, (): 1}, (0, 0)),
    ({(1, 1, 2): 1, (3,): -1}, (-INF, 2)),
    ({(2, 2, 2): 1, (1,): 4, (3,): -1}, (-2, 2)),
    ({(2, 2): 3, (2,): 1, (1, 1): -1}, (0, 0)),
    ({(1, 2, 3): -2, (): 4}, (-INF, 0)),
]
GRID = [Fraction(k, 2) for k in range(-6, 7)]


@pytest.mark.parametrize("chosen", list(itertools.combinations(range(len(ROWS)), 2)), ids=str)
def test_sweeps_keep_all_points(chosen):
    rows = Rows([BoxRow(poly(ROWS[k][0]), iv.around(*ROWS[k][1])) for k in chosen], [])
    for begin in ([(-3, 3)] * 3, [(-INF, INF), (-1, INF), (-INF, 2)], [(0, 3), (-3, 0), (-1, 1)]):
        kept = [
            x
            for x in itertools.product(GRID[::2], GRID, GRID[::3])
            if all(low <= v <= high for v, (low, high) in zip(x, begin, strict=True))
            and all(ROWS[k][1][0] <= poly(ROWS[k][0]).at(x) <= ROWS[k][1][1] for k in chosen)
        ]
        box = box_of(*begin)
        for _ in range(4):
            rows.sweep(box, False)
        for x in kept:
            assert all(low <= v <= high for v, (low, high) in zip(x, ends(box), strict=True))


def swept(given, cutoff=None, begin=((-INF, INF),) * 3, times=3):
    replay = Replay(given, cutoff, lambda *_: None)
    box = box_of(*begin)
    for _ in range(times):
        replay.rows(cutoff is not None).sweep(box, cutoff is not None)
    return box


def test_matrices_bound_their_entries():
    """[x y; y z] with x <= 4 and z <= 9 has |y| <= 6; |y| <= z for the cone (z, x, y)."""
    entries = [poly({(v,): 1}) for v in (1, 2, 3)]
    one = problem(3, {(): 0}, [Constraint("PSD", poly({}), entries)])
    found = ends(swept(one, begin=((-INF, 4), (-INF, INF), (-INF, 9))))
    assert found == [(0, 4), (-6, 6), (0, 9)]
    order = [entries[2], entries[0], entries[1]]
    cone = problem(3, {(): 0}, [Constraint("SECOND_ORDER", poly({}), order)])
    found = ends(swept(cone, begin=((-INF, INF), (-INF, INF), (-INF, 9))))
    assert found == [(-9, 9), (-9, 9), (0, 9)]


def test_rows_of_a_problem_and_of_the_cutoff():
    """x >= 1, y == x and x + y + z <= 7 with z >= 0; squares 2 (x - 1)^2 + 3 <= 5."""
    rows = [
        Constraint("NONNEGATIVE", poly({(1,): 1, (): -1})),
        Constraint("ZERO", poly({(1,): 1, (2,): -1})),
    ]
    given = problem(3, {(1,): 1, (2,): 1, (3,): 1}, rows)
    begin = ((-INF, INF), (-INF, INF), (0, INF))
    assert ends(swept(given, begin=begin)) == [(1, INF), (1, INF), (0, INF)]
    found = ends(swept(given, Fraction(7), begin))
    assert found == [(1, 6), (1, 6), (0, 5)]
    parabola = {(1, 1): 2, (1,): -4, (): 5}
    squares = [(Fraction(2), poly({(1,): 1, (): -1}))]
    for rest, wanted in ({}, (0, 2)), ({(2, 2): 1.0}, (-INF, INF)):
        given = problem(2, parabola | rest, squares=squares)
        replay = Replay(given, Fraction(5), lambda *_: None)
        assert replay.constant == (None if rest else 3)
        box = box_of((-INF, INF), (-INF, INF))
        for row in replay.rows(True).rows[1:]:  # that of the square alone
            Rows([row], []).sweep(box, True)
        assert ends(box)[0] == wanted


def inverse(**changes):
    found = {"rows": array("i8", 0), "variables": array("i8", 0), "inverse": array("f8", [0.5])}
    found |= {"centre": array("f8", 1.5), "radius": array("f8", 0.75)}
    return LeftInverse(found | changes, 2, "step")


@pytest.mark.parametrize(
    ("changes", "kind", "wanted"),
    [
        ({}, "ZERO", (0.75, 2.25)),
        ({"radius": array("f8", 0.5)}, "ZERO", (-INF, INF)),  # 0.25 radius + 0.375 = radius
        ({}, "NONNEGATIVE", (-INF, INF)),
        ({"centre": array("f8", 9.0)}, "ZERO", (-INF, INF)),
    ],
)
def test_a_left_inverse_bounds_solutions(changes, kind, wanted):
    """(2 + e) x = 3 with |e| <= 1/2: half of it is within 1/4 of x, and 3/8 at the centre."""
    row = Constraint(kind, poly({(1,): 2, (1, 2): 1, (): -3}))
    replay = Replay(problem(2, {(1,): 1}, [row]), None, lambda *_: None)
    box = box_of((-INF, INF), (-0.5, 0.5))
    inverse(**changes).apply(replay, box)
    assert ends(box)[0] == wanted


def test_a_left_inverse_needs_linear_rows_and_bounded_coefficients():
    line = {(1,): 2, (1, 2): 1, (): -3}
    for terms, e in ((line | {(1, 1): 2}, 0.5), (line | {(1, 1, 2): 1}, 0.5), (line, INF)):
        replay = Replay(problem(2, {(1,): 1}, [Constraint("ZERO", poly(terms))]), None, None)
        box = box_of((-INF, INF), (-e, e))
        inverse().apply(replay, box)
        assert ends(box)[0] == (-INF, INF)
    twice = {"variables": array("i8", 0, 0), "inverse": array("f8", [0.5], [0.5])}
    twice |= {"centre": array("f8", 1.5, 1.5), "radius": array("f8", 0.75, 0.75)}
    for changes in ({"radius": array("f8", 0.0)}, {"variables": array("i8", 2)}, twice):
        with pytest.raises(Malformed):
            inverse(**changes)


def sublevel(cutoff, *groups, scaling):
    found = {"scaling": scaling, "multipliers": list(groups), "products": NO_PRODUCTS}
    found |= {"priced": None, "is": "Identity"}
    return {"identity": found, "cutoff": cutoff}


MOVED = free(1, centre=array("f8", 1.0), scale=array("f8", 2.0))


@pytest.mark.parametrize(
    ("basis", "share", "floor"), [([[0], [1]], 0.5, 1.0), ([[1]], 0.5, 1.0), ([[0], [1]], 1.0, 4.0)]
)
@pytest.mark.parametrize(("cutoff", "wanted"), [(3, (-1, 3)), (2, (-1, 3)), (4, (-INF, INF))])
def test_sublevel_sets_bound_variables(basis, share, floor, cutoff, wanted):
    """x^2 - 2 x <= 3 says 1 - t^2 >= 0 for x = 1 + 2 t; t^2, or 1 + t^2, leaves a constant."""
    given = problem(1, {(1, 1): 1, (1,): -2})
    groups = [group([1], [[[0]]], [[[share]]]), group([0], [basis], [[[0.0]] * len(basis)], floor)]
    box = box_of((-INF, INF))
    step = Sublevel(sublevel(3.0, *groups, scaling=MOVED), 1, "step")
    step.apply(Replay(given, Fraction(cutoff), lambda *_: None), box)
    assert ends(box) == [wanted]


SET = group([1], [[[0, 0]]], [[[1.0]]])  # cutoff - f


@pytest.mark.parametrize(
    ("terms", "cutoff", "groups", "wanted"),
    [
        # 256 - 16 t^4 >= 0: t^4 <= 16
        ({(1,) * 4: 16}, 256, [group([1], [[[0, 0]]], [[[0.25]]]), [[1, 1]], 1.0], (-2, 2)),
        # x^2 + x^2 y^2 <= 16 says nothing of x^2 alone by x y
        ({(1, 1): 1, (1, 1, 2, 2): 1}, 16, [SET, [[0, 1], [1, 2]], 1.0], (-4, 4)),
        # x^2 / 4 as a square without a floor
        (
            {(1, 1): 1},
            4,
            [group([1], [[[0, 0]]], [[[0.5]]]), [[0, 0]], 1.0, group([0], [[[0, 1]]], [[[0.5]]])],
            (-INF, INF),
        ),
    ],
)
def test_sublevel_sets_bound_by_words_with_a_floor(terms, cutoff, groups, wanted):
    first, basis, floor, *more = groups
    all_ = [first, group([0], [basis], [[[0.0]] * len(basis)], floor), *more]
    given = problem(2, terms)
    box = box_of((-INF, INF), (-INF, INF))
    step = Sublevel(sublevel(float(cutoff), *all_, scaling=free(2)), 2, "step")
    step.apply(Replay(given, Fraction(cutoff), lambda *_: None), box)
    assert ends(box)[0] == wanted


def test_sublevel_sets_need_their_box_and_squares_without_a_generator():
    """x^3 <= 1/64 for x >= 0 says x <= 1/4; x times x^2 has no square of x alone."""
    given = problem(1, {(1, 1, 1): 1})
    groups = [group([1], [[[0]]], [[[1.0]]]), group([0], [[[0]]], [[[0.0]]], 1.0)]
    groups.append(group([3], [[[1]]], [[[0.0]]], 1.0))
    half = free(1, side=array("i8", 1))
    box = box_of((0, INF))
    step = Sublevel(sublevel(1 / 64, *groups, scaling=half), 1, "step")
    step.apply(Replay(given, Fraction(1, 64), lambda *_: None), box)
    assert ends(box) == [(0, INF)]
    square = problem(1, {(1, 1): 1})
    groups = [group([1], [[[0]]], [[[1.0]]]), group([0], [[[1]]], [[[0.0]]], 1.0)]
    step = Sublevel(sublevel(4.0, *groups, scaling=half), 1, "step")
    for low, wanted in ((-INF, (-INF, INF)), (0, (0, 2))):
        box = box_of((low, INF))
        step.apply(Replay(square, Fraction(4), lambda *_: None), box)
        assert ends(box) == [wanted]


def exact(row, value="1"):
    """A multiplier of one row, for x >= -9."""
    found = {"is": "ExactDual", "lower": array("f8", -9.0), "upper": array("f8", "inf")}
    found |= {"row": array("i8", row), "word": array("i4", [0]), "value": [value], "gram": None}
    return found


@pytest.mark.parametrize(
    ("row", "side", "claim", "uses_cutoff", "wanted"),
    [
        (0, 1, 1.0, False, (1, 9)),
        (0, 1, 1.5, False, (-9, 9)),
        (0, -1, 1.0, False, (-9, 9)),
        (1, -1, -2.0, True, (-9, 2)),
        (1, -1, -1.5, True, (-9, 9)),
        (1, -1, -2.0, False, (-9, 9)),  # row 1 is x >= -9 without the cutoff
        (0, 1, "-inf", False, (-9, 9)),
    ],
)
def test_tightenings_are_proved(row, side, claim, uses_cutoff, wanted):
    """The row x >= 1 and the cutoff x <= 2."""
    given = problem(1, {(1,): 1}, [Constraint("NONNEGATIVE", poly({(1,): 1, (): -1}))], -9, 9)
    step = Tightening(tightening(exact(row), claim, side, uses_cutoff), 1, "step")
    box = box_of((-9, 9))
    step.apply(Replay(given, Fraction(2), lambda *_: None), box)
    assert ends(box) == [wanted]


def test_the_cutoff_is_no_equation():
    """From 2 - x == 0 would follow x >= 2."""
    step = Tightening(tightening(exact(0, "-1"), 2.0, 1, True), 1, "step")
    with pytest.raises(Malformed, match="sign"):
        step.apply(Replay(problem(1, {(1,): 1}), Fraction(2), None), box_of((-9, 9)))


def test_points_are_boxes():
    assert not box_of((1, 1)).empty
    assert box_of((0, 1), (2, 1)).empty


# ---- trees and quotes ---------------------------------------------------------------------------


def part(**changes):
    found = {"steps": [], "argument": None, "empty": False, "branch": None, "children": []}
    return found | changes


def certificate(*parts, bound=0.0, cutoff=None):
    rest = {"fingerprint": "", "correction": 0.0, "assumptions": []}
    return rest | {"bound": bound, "cutoff": cutoff, "parts": list(parts)}


def proves(given, *certificates):
    return Certificates(list(certificates), given).prove()[0]


def test_a_tree_proves_the_least_of_its_leaves():
    """-x^2 + x on [0, 4], split at 1: the leaves give 0 - 1 and 1 - 16."""
    given = problem(2, {(1, 1): -1, (2,): 1}, low=[0, 0], high=[4, 1])
    root = part(branch=[0, 1.0], children=[1, 2])
    assert proves(given, certificate(root, part(), part())) == -16
    low = problem(2, {(1, 1): 1, (2,): 1}, low=[-4, 0], high=[4, 1])
    assert proves(low, certificate(part(branch=[0, 1.0], children=[1, 2]), part(), part())) == 0
    row = Constraint("NONNEGATIVE", poly({(1,): -1, (): 1.25}))
    right = problem(1, {(1,): -1}, [row], low=0, high=4)
    leaf = part(steps=[{"is": "Propagation", "sweeps": 1, "uses_cutoff": False}])
    halves = certificate(part(branch=[0, 1.5], children=[1, 2]), leaf, leaf)
    assert proves(right, halves) == -1.25
    both = certificate(part(branch=[0, 1.0], children=[2, 1]), part(), part())
    assert proves(given, both) == -16
    for children in ([1, 1], [0, 1], [1, 3], [1]):
        with pytest.raises(Malformed):
            proves(given, certificate(part(branch=[0, 1.0], children=children), part(), part()))


def tightening(argument, value, side=1, uses_cutoff=False):
    found = {"is": "Tightening", "variable": array("i8", 0), "side": array("i8", side)}
    return found | {"value": array("f8", value), "argument": argument, "uses_cutoff": uses_cutoff}


def below_end(value="1"):
    """-x >= -value * end from end - x >= 0 as an exact dual of one variable."""
    found = {"is": "ExactDual", "lower": array("f8", "-inf"), "upper": array("f8", 2.0)}
    found |= {"row": array("i8", 1), "word": array("i4", [0]), "value": [value], "gram": None}
    return found


def test_arguments_hold_on_the_box_that_they_assume():
    """-x >= -2 for x <= 2, which is no argument for x <= 3."""
    for high, bound in ((2, -2), (Fraction(3, 2), -1.5), (3, -3)):
        given = problem(1, {(1,): -1}, low=0, high=high)
        assert proves(given, certificate(part(argument=below_end()), bound=-2.0)) == bound


def test_steps_with_a_cutoff_prove_nothing_above_it():
    """x >= 3 by a row; where x <= 1 nothing is left, which proves x >= 1."""
    row = Constraint("NONNEGATIVE", poly({(1,): 1, (): -3}))
    sweep = {"is": "Propagation", "sweeps": 2, "uses_cutoff": True}
    given = problem(1, {(1,): 1}, [row])
    assert proves(given, certificate(part(steps=[sweep]), cutoff=1.0)) == 1
    plain = sweep | {"uses_cutoff": False}
    rows = [Constraint("ZERO", poly({(k,): 1, (k + 1,): -1})) for k in (1, 2)]
    chain = problem(3, {(1,): 1}, rows, low=[-INF, -INF, 3])
    assert proves(chain, certificate(part(steps=[sweep | {"sweeps": 1}, plain]), cutoff=1.0)) == 1
    assert proves(given, certificate(part(steps=[sweep]))) == -INF
    assert proves(given, certificate(part(steps=[plain]), cutoff=1.0)) == 3
    argument = exact(1) | {"lower": array("f8", "-inf")}
    with pytest.raises(Malformed, match="not there"):  # the last argument has no cutoff
        proves(given, certificate(part(argument=argument), cutoff=1.0))


def test_quoted_certificates_are_proved_in_turn():
    """x <= 2, quoted as -x >= -2 and as less; what quotes a false claim proves nothing by it."""
    row = Constraint("NONNEGATIVE", poly({(1,): -1, (): 2}))
    given = problem(1, {(1,): -3}, [row])
    sweep = {"is": "Propagation", "sweeps": 1, "uses_cutoff": False}
    known = {"is": "Known", "bounds": [[0, -1, 0]]}
    second = {"is": "Known", "bounds": [[0, -1, 1]]}
    last = certificate(part(steps=[second]), bound=-2.0)
    middle = certificate(part(steps=[known]), bound=-2.0)
    for claim, wanted in ((-2.0, -2), (-3.0, -3), (-1.0, -INF), ("-inf", -INF), ("inf", -INF)):
        first = certificate(part(steps=[sweep]), bound=claim)
        assert proves(given, first, middle) == 3 * wanted
        wanted = wanted if wanted == -2 else -INF  # the claim -2 in the middle needs -2
        assert proves(given, first, middle, last) == 3 * wanted
    with pytest.raises(Malformed, match="quoted"):
        proves(given, middle)
    other = {"is": "Known", "bounds": [[0, 1, 0]]}
    first = certificate(part(steps=[sweep]), bound=-2.0)
    assert proves(given, first, certificate(part(steps=[other]))) == -INF


def test_an_empty_leaf_needs_a_positive_bound_of_zero():
    """0 >= 1 from x >= 3 and x <= 2 by multipliers 1 and 1; by 1 and none nothing follows."""
    row = Constraint("NONNEGATIVE", poly({(1,): 1, (): -3}))
    given = problem(1, {(1,): 1}, [row], low=0, high=2)
    argument = below_end() | {"row": array("i8", 0, 2), "word": array("i4", [0], [0])}
    argument |= {"value": ["1", "1"]}
    assert proves(given, certificate(part(argument=argument, empty=True), bound="inf")) == INF
    argument |= {"row": array("i8", 2), "word": array("i4", [0]), "value": ["0"]}
    assert proves(given, certificate(part(argument=argument, empty=True), bound="inf")) == 0
