"""Forged steps: what a step claims of a box without proving it shrinks nothing.

Every problem here has a feasible point outside the box that the forgery claims.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.problem import generators
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Known,
    Propagation,
    Replay,
    Sublevel,
    Tightening,
    _root_above,
    coordinates,
    shrunk,
    sublevel_box,
)

INF = np.inf
NONE = np.zeros((0, 2), np.int64)
x, y = sp.variables(2)


def box_of(problem):
    return Interval(problem.lower, problem.upper)


def unit_box(n):
    return Scaling(np.zeros(n), np.ones(n), np.ones(n, bool), np.zeros(n, int))


def dual_of(problem, generator, value, owner=None):
    count = len(generator)
    return LinearDual(
        Scaling.of_box(box_of(problem)),
        np.array(generator, np.int64),
        np.zeros((count, 1), np.int32),
        np.array(value, float),
        np.zeros(count, np.int64) if owner is None else np.array(owner, np.int64),
        NONE,
    )


def squares(generator, basis, factor, floor=0.0):
    """One block: its monomials as words, and L."""
    return Multipliers(
        np.array([generator]), np.array([basis], np.int32), np.array([factor], float), floor
    )


def free(generator, value):
    return Multipliers(np.array([generator]), np.zeros((1, 1, 1), np.int32), np.array([[value]]))


def replayed(problem, *steps, cutoff=None, known=None):
    replay = Replay(problem, cutoff) if known is None else Replay(problem, cutoff, known)
    return BoxProof(steps).replay(replay)


def unchanged(problem, *steps, cutoff=None):
    box = replayed(problem, *steps, cutoff=cutoff)
    assert box.lo.tolist() == problem.lower.tolist()
    assert box.hi.tolist() == problem.upper.tolist()


# ---- tightened bounds -------------------------------------------------------------------------


def quarter(least=0.25):
    """x >= 1/4 in [-1, 1]^2; multiplier 1 of the row proves it."""
    problem = sp.Problem(y, [x >= least], lower=-1, upper=1)
    return problem, Tightening(
        np.array([0]),
        np.array([1]),
        np.array([least - 1e-9]),
        dual_of(problem, [1], [1.0]),
        False,
    )


@pytest.mark.parametrize("above", [1e-12, 5e-10, 1e-6])
def test_a_claim_above_what_is_proved_is_skipped(above):
    problem, step = quarter()
    proved = float(step.reached(problem.rows, problem.equality, problem.matrices)[0])
    assert 0.25 - 1e-11 <= proved <= 0.25
    exact = replace(step, value=np.array([proved]))
    assert replayed(problem, exact).lo[0] == proved
    unchanged(problem, replace(step, value=np.array([proved + above])))


def test_an_identity_speaks_of_one_bound_only():
    """x + y >= 3/2 in the unit square: both may be 1/2, but their sum may not."""
    problem = sp.Problem(x, [x + y >= 1.5], lower=0, upper=1)
    scaling = Scaling.of_box(box_of(problem))
    identity = Identity(scaling, (squares(1, [[0]], [[1.0]]),))
    step = Tightening(np.array([0, 1]), np.ones(2, int), np.full(2, 0.9), identity, False)
    unchanged(problem, step)
    unchanged(problem, replace(step, value=np.array([0.9, 0.9]), variable=np.array([0, 0])))


def test_each_bound_needs_a_side_of_its_own():
    """2 y >= 1/4 says y >= 1/8, not y >= 1/4."""
    problem = sp.Problem(x, [x >= 0.25, 2 * y >= 0.25], lower=-1, upper=1)
    dual = dual_of(problem, [1, 2], [1.0, 1.0], owner=[0, 1])
    step = Tightening(np.array([0, 1]), np.array([1, 1]), np.array([0.2, 0.1]), dual, False)
    good = replayed(problem, replace(step, argument=dual_of(problem, [1, 2], [1, 0.5], [0, 1])))
    assert good.lo.tolist() == [0.2, 0.1]
    unchanged(problem, replace(step, side=np.array([1, 2]), value=np.array([0.2, 0.2])))


def test_sides_are_part_of_what_is_bounded():
    """-x >= -3/4 and x >= 1/4; without the side x >= 1/4 would say x <= -1/4."""
    problem = sp.Problem(y, [x >= 0.25, x <= 0.75], lower=-1, upper=1)
    dual = dual_of(problem, [1, 2], [1.0, 1.0], owner=[0, 1])
    step = Tightening(np.array([0, 0]), np.array([1, -1]), np.array([0.2, -0.8]), dual, False)
    box = replayed(problem, step)
    assert (box.lo[0], box.hi[0]) == (0.2, 0.8)
    unchanged(problem, replace(step, side=np.array([-1, 1]), value=np.array([0.2, -0.7])))
    system = coordinates(np.array([1, 0]), np.array([-1, 1]), 2)
    assert system.values(np.array([3.0, 5.0])).tolist() == [-5.0, 3.0]
    ends = shrunk(box_of(problem), np.array([0, 1]), np.array([1, -1]), np.array([-0.5, -0.25]))
    assert ends.lo.tolist() == [-0.5, -1.0] and ends.hi.tolist() == [1.0, 0.25]


@pytest.mark.parametrize("kind", [np.int8, np.int64, np.float16, np.longdouble, object])
def test_values_of_types_that_wrap_or_round_are_skipped(kind):
    """-(-128) is -128 in bytes: x <= 128 would become x <= -128."""
    problem = sp.Problem(y, lower=-1, upper=1)
    dual = dual_of(problem, [], [])
    step = Tightening(np.array([0]), np.array([-1]), np.array([-128.0]), dual, False)
    unchanged(problem, step)
    unchanged(problem, replace(step, value=np.array([-128]).astype(kind)))


def test_values_and_sides_are_as_many_as_variables():
    problem, step = quarter()
    for fields in (
        {"value": np.array([0.2, 0.2])},
        {"side": np.array([1, 1])},
        {"variable": np.array([0, 1])},
        {"value": np.array([[0.2]])},
        {"variable": np.array([0], np.int16)},
        {"variable": np.array([2])},
        {"variable": np.array([-1])},
    ):
        unchanged(problem, replace(step, **fields))


# ---- the cutoff -------------------------------------------------------------------------------


def test_steps_without_the_cutoff_do_not_see_it():
    """No point of the unit square has x + y <= -1; without the cutoff nothing is empty."""
    problem = sp.Problem(x + y, lower=0, upper=1)
    _, low, _ = generators.bound_family(0, 2)
    # -x = (-1 - x - y) + y + 1 with the cutoff row as generator 1
    dual = dual_of(problem, [1, low.start + 2], [1.0, 0.5])
    step = Tightening(np.array([0]), np.array([-1]), np.array([0.9]), dual, False)
    for steps in ((Propagation(3, False),), (step,)):
        unchanged(problem, *steps, cutoff=-1.0)
        root = Node(BoxProof(steps))
        verdict = Certificate(problem.fingerprint, INF, root, -1.0).verify(problem)
        assert not verdict.ok and verdict.bound <= 0.0


def test_a_box_rests_on_the_cutoff_as_soon_as_one_step_does():
    """min x over [0, 1] with the cutoff -1: an empty box proves -1 and no more."""
    problem = sp.Problem(x + 0 * y, lower=0, upper=1)
    for steps in (
        (Propagation(1, False), Propagation(1, True)),
        (Propagation(1, True), Propagation(1, False)),
    ):
        assert BoxProof(steps).uses_cutoff
        verdict = Certificate(problem.fingerprint, INF, Node(BoxProof(steps)), -1.0).verify(problem)
        assert verdict.bound == -1.0 and not verdict.ok
    assert not BoxProof((Propagation(1, False),)).uses_cutoff


@pytest.mark.parametrize("kind", ["propagation", "tightening"])
def test_what_rests_on_one_cutoff_is_not_kept_for_another(kind):
    """x <= 0.3 holds where x <= 0.3, and says nothing about the minimum of -x."""
    first = sp.Problem(x + 0 * y, lower=0, upper=1)
    other = first.with_objective(-1.0 * x)
    if kind == "propagation":
        step = Propagation(2, True)
    else:
        dual = dual_of(sp.Problem(x + 0 * y, [x >= 0], 0, 1), [1], [1.0])
        step = Tightening(np.array([0]), np.array([-1]), np.array([-0.3 - 1e-9]), dual, True)
    root, known = Node(BoxProof((step,))), {}
    assert replayed(first, step, cutoff=0.3, known=known).hi[0] <= 0.3 + 1e-8
    Certificate(first.fingerprint, 0.0, root, 0.3).verify(first, known)
    verdict = Certificate(other.fingerprint, -0.4, root, 5.0).verify(other, known)
    assert not verdict.ok and verdict.bound <= -1.0
    assert replayed(first, step, cutoff=0.9, known=known).hi[0] >= 0.9


def test_remembered_boxes_belong_to_their_feasible_set():
    """The same step shrinks x >= 1/2, and not x >= -1/2."""
    step, known = Propagation(2, False), {}
    narrow, wide = (sp.Problem(x + 0 * y, [x >= a], -1, 1) for a in (0.5, -0.5))
    assert replayed(narrow, step, known=known).lo[0] >= 0.4
    assert replayed(wide, step, known=known).lo[0] <= -0.5
    assert replayed(narrow, step, known=known).lo[0] >= 0.4


def test_remembered_boxes_keep_their_steps_alive():
    """Otherwise another step could be found at the place in memory of an earlier one."""
    known = {}
    problem = sp.Problem(y, [x >= 0.25], lower=-1, upper=1)
    for k in range(200):
        step = Propagation(2 * (k % 2), False)
        box, _ = Replay(problem, None, known).begun((step,))
        assert box.lo[0] == (-1.0 if k % 2 == 0 else pytest.approx(0.25, abs=1e-12))
        del step


def test_remembered_arguments_are_kept_alive():
    """Likewise for what a step was found to prove."""
    known = {}
    problem = sp.Problem(y, [x >= 0.25, x <= 0.75], lower=-1, upper=1)
    for k in range(200):
        side = 1 if k % 2 else -1
        dual = dual_of(problem, [1 if side > 0 else 2], [1.0])
        value = np.array([0.2 if side > 0 else -0.8])
        step = Tightening(np.array([0]), np.array([side]), value, dual, False)
        replay = Replay(problem, None, known)
        box = replay.step(step, box_of(problem))
        assert (box.lo[0], box.hi[0]) == ((0.2, 1.0) if side > 0 else (-1.0, 0.8))
        del step, dual, replay


# ---- quotes -----------------------------------------------------------------------------------


def test_a_quote_of_twice_a_variable_is_none():
    """2 x >= 1/4 is proved, and x >= 1/4 is false."""
    problem = sp.Problem(y, [2 * x >= 0.25], lower=-1, upper=1)
    about = problem.with_objective(2.0 * x)
    proof = Certificate(about.fingerprint, 0.25 - 1e-9, Node(BoxProof((Propagation(3, False),))))
    assert proof.verify(about).ok
    for side in (2, 2.0, 0.5, 0, -2):
        unchanged(problem, Known(((0, side, proof),)))


@pytest.mark.parametrize("side", [1, -1])
def test_quotes_hold_for_their_side(side):
    """x in [1/4, 3/4]: quoted from either side, and not for the other."""
    problem = sp.Problem(y, [x >= 0.25, x <= 0.75], lower=-1, upper=1)
    about = problem.with_objective(float(side) * x)
    bound = (0.25 if side > 0 else -0.75) - 1e-9
    proof = Certificate(about.fingerprint, bound, Node(BoxProof((Propagation(3, False),))))
    assert proof.verify(about).ok
    box = replayed(problem, Known(((0, side, proof),)))
    assert box.lo[0] == (bound if side > 0 else -1.0)
    assert box.hi[0] == (1.0 if side > 0 else -bound)
    greedy = replace(proof, bound=bound + 0.5)
    unchanged(problem, Known(((0, side, greedy),)))
    unchanged(problem, Known(((0, -side, replace(proof, bound=0.3)),)))


# ---- sublevel sets ----------------------------------------------------------------------------


def sublevel(problem, *groups, cutoff=0.0, scaling=None):
    scaling = scaling or Scaling.of_box(box_of(problem))
    return Sublevel(Identity(scaling, tuple(groups)), cutoff)


def below(problem, step, cutoff=0.0):
    return sublevel_box(problem, cutoff, step, box_of(problem))


ONE, X, Y = [0, 0], [0, 1], [0, 2]


def disc(radius=4.0):
    """radius - x^2 >= 0 without bounds; 0 = (radius - x^2) + (1 + x^2) - (radius + 1)."""
    problem = sp.Problem(x + 0 * y, [radius - x**2 >= 0])
    row = squares(1, [ONE], [[1.0]])
    return problem, row, squares(0, [ONE, X], np.zeros((2, 1)), 1.0)


def test_the_sublevel_box_is_that_of_the_square():
    problem, row, floor = disc()
    box = below(problem, sublevel(problem, row, floor))
    assert -2.0 - 1e-9 <= box.lo[0] <= -2.0 and 2.0 <= box.hi[0] <= 2.0 + 1e-9
    assert box.lo[1] == -INF and box.hi[1] == INF


def boxed(size):
    """4 - x^2 >= 0 over [-10, 10]^2, in t = x / 10: 4 - 100 t^2."""
    problem = sp.Problem(x + 0 * y, [4.0 - x**2 >= 0], lower=-10, upper=10)
    scaling = Scaling(np.zeros(2), np.full(2, size), np.ones(2, bool), np.zeros(2, int))
    return problem, scaling, squares(1, [ONE], [[1.0 / size]])


def test_squares_without_a_floor_bound_nothing():
    """y is free in its box: a block of y with the floor 0 proves nothing of it."""
    problem, scaling, row = boxed(16.0)
    floor = squares(0, [ONE, X], np.zeros((2, 1)), 1.0)
    empty = squares(0, [ONE, Y], np.zeros((2, 1)), 0.0)
    for groups in ((row, floor, empty), (row, empty, floor)):
        box = below(problem, sublevel(problem, *groups, scaling=scaling))
        assert box.lo[1] == -10 and box.hi[1] == 10 and box.hi[0] <= 2.1


def test_squares_of_other_generators_bound_nothing():
    """1e-9 y^2 (4 - x^2) is small wherever x^2 is near 4: nothing follows for y."""
    problem, scaling, row = boxed(16.0)
    floor = squares(0, [ONE, X], np.zeros((2, 1)), 1.0)
    other = squares(1, [ONE, Y], np.zeros((2, 1)), 1e-9)
    for groups in ((row, floor, other), (other, row, floor)):
        box = below(problem, sublevel(problem, *groups, scaling=scaling))
        assert box.lo.tolist()[1] == -10 and box.hi.tolist()[1] == 10
        assert 2.0 <= box.hi[0] <= 2.1


def test_mixed_monomials_bound_no_variable():
    """4 - (x y)^2 >= 0 allows x = 10 with y = 0."""
    problem = sp.Problem(x + 0 * y, [4.0 - x**2 * y**2 >= 0], lower=-10, upper=10)
    scaling = Scaling(np.zeros(2), np.full(2, 16.0), np.ones(2, bool), np.zeros(2, int))
    row = squares(1, [ONE], [[1.0 / 256.0]])
    floor = squares(0, [ONE, [1, 2]], np.zeros((2, 1)), 1.0)
    box = below(problem, sublevel(problem, row, floor, scaling=scaling))
    assert box.lo.tolist() == [-10.0, -10.0] and box.hi.tolist() == [10.0, 10.0]


@pytest.mark.parametrize("exponent", [33, 40, 60])
def test_a_room_that_cancels_is_taken_at_its_upper_end(exponent):
    """2^-2k - x^2 >= 0 holds at 2^-k; the room is what is left of (1 + 2^-2k) - 1."""
    problem, row, floor = disc(2.0 ** (-2 * exponent))
    box = below(problem, sublevel(problem, row, floor))
    assert box.hi[0] >= 2.0**-exponent and box.lo[0] <= -(2.0**-exponent)


@pytest.mark.parametrize("start", [2.0**40, -(2.0**44), 2.0**50])
def test_a_sublevel_box_far_away_is_rounded_outwards(start):
    """(1 - t^2) + (1 + t^2) = 2 gives |t| <= 1, that is the whole box, whose ends are feasible."""
    problem = sp.Problem(x + 0 * y, lower=[start, 0], upper=[start + 1, 0])
    box, _, _ = generators.bound_family(1, 2)
    row = squares(box.start, [ONE], [[1.0]])
    floor = squares(0, [ONE, X], np.zeros((2, 1)), 1.0)
    found = below(problem, sublevel(problem, row, floor, cutoff=0.0))
    assert found.lo[0] == start and found.hi[0] == start + 1


@pytest.mark.parametrize("floor", [0.25, 1.0, 4.0])
def test_the_floor_divides(floor):
    """K = 4 s + floor with s = floor: |x|^2 <= 4 for every floor."""
    problem, _, _ = disc()
    row = squares(1, [ONE], [[np.sqrt(floor)]])
    step = sublevel(problem, row, squares(0, [ONE, X], np.zeros((2, 1)), floor))
    box = below(problem, step)
    assert box.hi[0] >= 2.0 and box.hi[0] <= 2.0 + 1e-6


def test_a_sublevel_identity_holds_below_its_cutoff_only():
    """x^2 <= 1 where x^2 <= 1; at the cutoff 9 the point 3 belongs to the set."""
    problem = sp.Problem(x**2 + 0 * y)
    row = squares(1, [ONE], [[1.0]])
    step = sublevel(problem, row, squares(0, [ONE, X], np.zeros((2, 1)), 1.0), cutoff=1.0)
    assert 1.0 <= below(problem, step, 1.0).hi[0] <= 1.0 + 1e-9
    assert below(problem, step, 0.5).hi[0] <= 1.0 + 1e-9
    for cutoff in (1.0 + 1e-12, 9.0, None):
        assert below(problem, step, cutoff).hi[0] == INF
    for own in (INF, np.nan, -INF):
        assert below(problem, replace(step, cutoff=own), 9.0).hi[0] == INF


def test_a_sublevel_identity_assumes_a_box_that_it_does_not_prove():
    """On [-1/2, 1/2] all is bounded; the set is [-2, 2]."""
    problem = sp.Problem(x + 0 * y, [4.0 - x**2 >= 0], lower=-9, upper=9)
    step = sublevel(
        problem,
        squares(0, [ONE, X], np.zeros((2, 1)), 1.0),
        scaling=Scaling(np.zeros(2), np.full(2, 0.5), np.ones(2, bool), np.zeros(2, int)),
    )
    unchanged(problem, step, cutoff=0.0)


class Bad(float):
    """A number whose powers are what somebody says they are."""

    said: float

    def __pow__(self, exponent):
        return np.full(np.shape(exponent), self.said)


def bad(value, said):
    number = Bad(value)
    number.said = said
    return number


@pytest.mark.parametrize("value", [2.0, 4.0, 1e-9, 1e9])
@pytest.mark.parametrize("power", [2, 4, 6])
def test_roots_that_a_bad_library_returns_are_not_believed(value, power):
    true = value ** (1.0 / power)
    for factor in (0.5, 1 - 1e-11, 1 - 1e-13, 1.0, 1.5):
        found = float(_root_above(bad(value, true * factor), np.array([power]))[0])
        assert Fraction(found) ** power >= Fraction(value)
    for steps in range(-8, 9):  # near the root, where rounding of the power decides
        near = (true + steps * np.spacing(true)) / (1.0 + 1e-12)
        found = float(_root_above(bad(value, near), np.array([power]))[0])
        assert Fraction(found) ** power >= Fraction(value)
