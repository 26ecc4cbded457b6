"""Forged boxes from rows that share uncertain numbers: directions, lifted products, far faces.

The system: b gamma + e = 1, b + 4 e = 1/4, b - 4 e = 7/20 with the same e in all rows, so that
b = 3/10, e = -1/80 and gamma = 27/8 is the only solution; rows one by one leave b around zero.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.uncertain_rows import (
    CoupledRows,
    UncertainRows,
    complete_box,
    direction_box,
    lifted_box,
    lifted_rows,
    parameter_box,
)
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation
from sparsepop_py.verified.uncertain_rows.directions import (
    LARGEST,
    cubes,
    exact_units,
    suits,
    within,
)
from sparsepop_py.verified.uncertain_rows.lifted_products import (
    LiftedBox,
    joined_equations,
    sum_objectives,
)
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import CoefficientLimit, Faces

INF = np.inf
F = Fraction
ANY = np.array([[-INF, -INF], [INF, INF]])
b, gamma, e = sp.variables(3, ["b", "gamma", "e"])
TRUTH = (0.3, 3.375, -0.0125)


def coupled_of(equations, reach=0.1, parameters=2):
    n = equations[0].polynomial.dimension
    bounds = np.full(n, reach)
    bounds[:parameters] = INF
    problem = sp.Problem(sp.variables(n)[0], equations, -bounds, bounds)
    return CoupledRows(problem, parameters, np.ones(len(equations), bool), np.zeros(n))


EQUATIONS = [b * gamma + e == 1, b + 4 * e == 0.25, b - 4 * e == 0.35]
SHARED = coupled_of(EQUATIONS)


# ---- far faces --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def known():
    """Rows in products, their box, and the faces of what is left without bounds."""
    rows = lifted_rows(SHARED, ("b", "gamma"))
    box = lifted_box(rows, ANY)
    last = box.rounds[-1]
    ends, start = np.array([last.lower, last.upper]), np.array([box.lower, box.upper])
    assert start[0, 0] < 0 < start[1, 0] and np.isinf(start[:, 1]).all()
    return rows, box, Faces.of(SHARED, rows, ends, start)


def proof_of(faces, face, reach, sweeps=60):
    """Propagation alone shows that the face holds no point."""
    problem = faces.problem(face, faces.unknowns(face, reach))
    return Certificate(problem.fingerprint, INF, Node(BoxProof((Propagation(sweeps, False),))))


def with_limit(known, reach, proofs, parameters=(1,)):
    _, box, _ = known
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[1], upper[1] = -reach, reach
    limit = CoefficientLimit(parameters, reach, proofs)
    return replace(box, lower=lower, upper=upper, limit=limit)


def test_a_limit_beyond_the_solution_is_proved_and_one_below_it_is_not(known):
    """gamma = 27/8 is consistent: no limit below it may be proved, by whatever."""
    rows, _, faces = known
    assert faces.far == (1,) and faces.partners == {0}
    good = with_limit(known, 1024.0, (proof_of(faces, 1, 1024.0),))
    assert good.verify(rows, ANY, SHARED)
    for reach in (3.0, 1.0, 0.1):
        forged = with_limit(known, reach, (proof_of(faces, 1, reach),))
        assert not forged.verify(rows, ANY, SHARED)
        stolen = with_limit(known, reach, (proof_of(faces, 1, 1024.0),))
        assert not stolen.verify(rows, ANY, SHARED)


def test_limits_need_their_proofs(known):
    rows, _, faces = known
    proof = proof_of(faces, 1, 1024.0)
    for reach, proofs, parameters in (
        (1024.0, (None,), (1,)),
        (1024.0, (), (1,)),
        (1024.0, (proof, proof), (1,)),
        (1024.0, (proof,), (0,)),
        (1024.0, (proof, proof), (0, 1)),
        (1024.0, (), ()),
        (1024.0, (replace(proof, bound=5.0),), (1,)),
        (1024.0, (replace(proof, root=Node()),), (1,)),
        (1024.0, (replace(proof, fingerprint=""),), (1,)),
        (1024.0, (proof,), (True,)),
        (1024.0, (proof,), (np.int64(1),)),
        (INF, (proof,), (1,)),
        (-1024.0, (proof,), (1,)),
        (0.0, (proof,), (1,)),
        (np.nan, (proof,), (1,)),
        (1024, (proof,), (1,)),
    ):
        forged = with_limit(known, 1024.0, (proof,))
        forged = replace(forged, limit=CoefficientLimit(parameters, reach, proofs))
        assert not forged.verify(rows, ANY, SHARED)
    good = with_limit(known, 1024.0, (proof,))
    assert not replace(good, limit=None).verify(rows, ANY, SHARED)
    assert not replace(good, limit=(1,)).verify(rows, ANY, SHARED)
    assert not good.verify(rows, ANY)  # nobody vouches for shared numbers
    assert not good.verify(rows, ANY, coupled_of(EQUATIONS, reach=0.2))


@pytest.mark.parametrize("at", [(0.3, 3.375, -0.0125), (-0.125, -64.0, 0.0625), (0.25, 80.0, 0.0)])
def test_faces_hold_every_point_beyond_the_limit(known, at):
    """c = b / s, s = 1 / gamma, phi = gamma s = 1: each row of the face is s times one of ours."""
    _, _, faces = known
    b_, g_, e_ = (F(v) for v in at)
    constant = [b_ * g_ + e_, b_ + 4 * e_, b_ - 4 * e_]
    moved = [
        row.polynomial + float(c0 - c)
        for row, c0, c in zip(EQUATIONS, [F(1), F(0.25), F(0.35)], constant, strict=True)
    ]
    there = replace(faces, coupled=coupled_of([p == 0 for p in moved]))
    s = 1 / g_
    point = [b_ / s, s, e_]  # the face gives c for b and s for gamma
    for row in there.constraints[1]:
        total = F(0)
        for word, value in zip(
            row.polynomial.words.tolist(), row.polynomial.coefficients, strict=True
        ):
            term = F(value)
            for letter in word:
                term *= point[letter - 1] if letter else 1
            total += term
        assert abs(total) <= F(1, 10**9)  # the constants of the rows are rounded
    box = there.unknowns(1, abs(float(g_)) * 0.5)
    assert box[0, 1] <= float(s) <= box[1, 1]


def test_the_bound_of_the_inverse_is_rounded_outwards(known):
    _, _, faces = known
    for reach in (3.0, 7.0, 49.0, 1e3):
        box = faces.unknowns(1, reach)
        near = [abs(v) for v in box[:, 1] if abs(abs(v) * reach - 1) < 1e-9]  # or it is smaller
        assert near and all(F(v) >= 1 / F(reach) for v in near)


def test_limits_bound_both_ends():
    limit = CoefficientLimit((1,), 4.0, (None,))
    assert limit.within(ANY).tolist() == [[-INF, -4.0], [INF, 4.0]]
    assert limit.within(np.array([[0.0, -1.0], [1.0, 9.0]])).tolist() == [[0, -1], [1, 4]]


# ---- lifted products --------------------------------------------------------------------------


def test_rounds_are_replayed_not_believed(known):
    rows, box, _ = known
    assert box.verify(rows, ANY)
    far = [replace(box.rounds[0], steps=()), replace(box.rounds[0], lower=np.array([0.2, 0.9]))]
    for forged in (
        replace(box, rounds=(), sums=()),
        replace(box, rounds=box.rounds[:1], sums=()),
        replace(box, rounds=(far[0], *box.rounds[1:])),
        replace(box, rounds=(far[1], *box.rounds[1:]), lower=np.array([0.2, -INF])),
        replace(box, lower=box.lower + [0.1, 0.0]),
        replace(box, upper=box.upper - [0.1, 0.0]),
        replace(box, lower=np.array([-INF, 0.0])),
        replace(box, upper=np.array([INF, 9.0])),
    ):
        assert not forged.verify(rows, ANY)
    assert not box.verify(lifted_rows(coupled_of(EQUATIONS, 0.2), ("b", "gamma")), ANY)


def test_emptiness_of_a_round_needs_its_proof(known):
    rows, box, _ = known
    nothing = np.full(2, INF)
    crossing = ParameterBox(box.rounds[0].names, nothing, -nothing, box.rounds[0].start, ())
    forged = LiftedBox(box.names, nothing, -nothing, (crossing,), ((),))
    assert not forged.verify(rows, ANY)
    false = LinearBound("INFEASIBLE", INF, INF, None, ())
    given = LiftedBox(box.names, nothing, -nothing, box.rounds[:1], ((false,),))
    assert not given.verify(rows, ANY)


def test_equations_in_sums_of_monomials_keep_their_solutions(known):
    """Columns b and b gamma as unknowns of their own: the solution solves the joined equations."""
    rows, box, _ = known
    joined = joined_equations(SHARED, rows, box.rounds[-1])
    at = np.array([0.3, 0.3 * 3.375, -0.0125])
    assert joined.violation(at) < 1e-9
    assert joined.lower[2] == -0.1 and joined.upper[2] == 0.1
    assert joined.lower.tolist()[:2] == box.rounds[-1].lower.tolist()


def test_columns_that_share_less_than_all_factors_are_not_joined():
    """b gamma + b in one row and b gamma - b in the other are not one column."""
    merged = coupled_of([b * gamma + b + e == 1])
    rows = lifted_rows(merged, ("b", "gamma"))
    assert len(rows.columns) == 1
    last = parameter_box(rows.regression, rows.start(ANY))
    assert joined_equations(merged, rows, last) is not None
    other = coupled_of([b * gamma - b + e == 1])
    assert joined_equations(other, rows, last) is None
    more = coupled_of([b * gamma + b + gamma + e == 1])
    assert joined_equations(more, rows, last) is None
    fewer = coupled_of([b * gamma + e == 1])
    assert joined_equations(fewer, rows, last) is None


def test_widths_of_shared_numbers_are_rounded_upwards():
    """e (1/3) twice and e f: widths in rationals; unbounded numbers make no rows."""
    x, p, q = sp.variables(3)
    for third, reach in ((1 / 3, 0.1), (0.7, 1 / 3), (1e-200, 1e-200)):
        equations = [x + third * p * x + third * q * x + third * p * q == 1]
        bounds = np.array([INF, reach, reach])
        problem = sp.Problem(x, equations, -bounds, bounds)
        coupled = CoupledRows(problem, 1, np.ones(1, bool), np.zeros(3))
        rows = lifted_rows(coupled, ("x",)).regression
        exact = F(third) * F(reach)
        assert rows.target.tolist() == [-1.0] and rows.regressors.tolist() == [[1.0]]
        assert F(rows.radii[0, 0]) >= 2 * exact
        assert F(rows.radius[0]) >= exact * F(reach)
        assert rows.radii[0, 0] <= 2 * float(exact) * (1 + 1e-14) + 1e-300
    free = sp.Problem(x, [x + p * x == 1], [-INF, -1, -INF], [INF, INF, INF])
    assert lifted_rows(CoupledRows(free, 1, np.ones(1, bool), np.zeros(3)), ("x",)) is None


GAINS = ["b0", "b1", "a", "gamma"]


def with_gain():
    """(b0 + b1) gamma from rows of the products; b0 + b1 = 1 + a."""
    b0, b1, a, g, f = sp.variables(5, [*GAINS, "f"])
    equations = [b0 * g + f == 0.5, b1 * g - f == 1.0, a == 0.5 + f]
    bounds = np.array([INF, INF, INF, INF, 0.25])
    coupled = CoupledRows(
        sp.Problem(b0, equations, -bounds, bounds), 4, np.ones(3, bool), np.zeros(5)
    )
    rows = lifted_rows(coupled, tuple(GAINS))
    return coupled, replace(rows, gains=(((0, 1), (2,)),))


@pytest.fixture(scope="module")
def gain():
    coupled, rows = with_gain()
    start = np.array([np.full(4, -INF), np.full(4, INF)])
    return coupled, rows, start, complete_box(lifted_box(rows, start), coupled, rows)


def test_sums_of_products_need_their_bounds(gain):
    """gamma = 3/2 / (1 + a) with a in [1/4, 3/4]: in [6/7, 6/5] where the sum is known."""
    coupled, rows, start, box = gain
    place = GAINS.index("gamma")
    assert box.lower[place] <= 6 / 7 and 6 / 5 <= box.upper[place]
    assert box.verify(rows, start, coupled)
    assert box.sums and box.sums[0]
    sums = box.sums[0]
    for forged in (
        (sums[1], sums[0], *sums[2:]),
        sums[:-1],
        (*sums, sums[0]),
        (replace(sums[0], lower=sums[0].lower + 1.0), *sums[1:]),
    ):
        given = replace(box, sums=(forged, *box.sums[1:]))
        assert not given.verify(rows, start, coupled)


def test_sharper_sums_need_their_certificates(gain):
    """b0 gamma + b1 gamma = 3/2 as f is shared: the sum may not be claimed to be more."""
    coupled, rows, start, box = gain
    joined = joined_equations(coupled, rows, box.rounds[-1])
    asked = sum_objectives(joined, rows)
    assert asked and box.sums[-1]
    trivial = [Certificate(joined.with_objective(f).fingerprint, -99.0, Node()) for f in asked]
    honest = replace(box, lower=start[0], upper=start[1], sharper=tuple(trivial), limit=None)
    assert honest.verify(rows, start, coupled)
    for k in range(len(trivial)):
        greedy = list(trivial)
        greedy[k] = replace(trivial[k], bound=7.0)
        assert not replace(honest, sharper=tuple(greedy)).verify(rows, start, coupled)
    swapped = (trivial[1], trivial[0], *trivial[2:])
    assert not replace(honest, sharper=swapped).verify(rows, start, coupled)
    assert not replace(honest, sharper=tuple(trivial[:-1])).verify(rows, start, coupled)
    assert not replace(honest, sharper=tuple(trivial)).verify(rows, start)


# ---- directions -------------------------------------------------------------------------------


def balance(limit=2.5):
    """(1 + e) x + y = 1, (1 - e) x + y = 2, x = y: x = y = 3/4 and e = -2/3."""
    x, y, f = sp.variables(3, ["x", "y", "e"])
    equations = [x + f * x + y == 1, x - f * x + y == 2, x - y == 0]
    radii = np.array([[limit, 0.0], [limit, 0.0], [0.0, 0.0]])
    slopes = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    rows = UncertainRows(("x", "y"), [-1, -2, 0], slopes, np.zeros(3), radii)
    return rows, coupled_of(equations, limit)


@pytest.fixture(scope="module")
def direction():
    rows, coupled = balance()
    return rows, coupled, direction_box(rows, coupled, parameter_box(rows))


def test_directions_are_checked_one_by_one(direction):
    rows, coupled, box = direction
    assert box.verify(rows, coupled, ANY)
    proofs = box.certificates
    for fields in (
        {"scale": box.scale * 1.5},
        {"scale": -box.scale},
        {"scale": box.scale[:1]},
        {"scale": box.scale * 2.0**70},
        {"certificates": proofs[::-1]},
        {"certificates": proofs[:3]},
        {"certificates": (*proofs, proofs[0])},
        {"certificates": (proofs[1], proofs[0], *proofs[2:])},
        {"certificates": (replace(proofs[0], bound=proofs[0].bound + 1.0), *proofs[1:])},
        {"rows": box.rows[:3]},
        {"rows": (*box.rows[:3], 0)},
        {"rows": (*box.rows[:3], -1)},
        {"rows": (*box.rows[:3], True)},
        {"rows": (*box.rows[:3], 1.0)},
        {"first": replace(box.first, lower=np.zeros(2))},
        {"last": replace(box.last, lower=np.full(2, 0.8))},
        {"lower": np.full(2, 0.8)},
        {"upper": np.full(2, 0.7)},
    ):
        assert not replace(box, **fields).verify(rows, coupled, ANY), fields
    for other in (balance(2.6), (rows, balance(2.6)[1]), (balance(2.6)[0], coupled)):
        assert not box.verify(*other, ANY)


def test_the_worst_direction_bounds_the_box(direction):
    """A certificate of 0 proves nothing of its side, whichever side it is."""
    rows, coupled, box = direction
    for k in range(4):
        proofs = list(box.certificates)
        proofs[k] = replace(proofs[k], bound=min(0.0, proofs[k].bound))
        assert not replace(box, certificates=tuple(proofs)).verify(rows, coupled, ANY)


@pytest.mark.parametrize("theta", [(0.75, 0.75), (-2.0, 0.5), (0.25, -8.0)])
@pytest.mark.parametrize("scale", [(1.0, 1.0), (4.0, 0.5), (0.25, 64.0)])
def test_directions_of_solutions_lie_in_the_cube(theta, scale):
    """phi = s theta / c with max |phi| = 1, s = 1 / t: rows times s hold in rationals."""
    x, y, f = sp.variables(3, ["x", "y", "e"])
    at, noise = [F(v) for v in theta], F(1, 8)
    rows = [x + f * x + y, x - 3.0 * f * y, 2.0 * y + f]
    values = [at[0] + noise * at[0] + at[1], at[0] - 3 * noise * at[1], 2 * at[1] + noise]
    equations = [row - float(v) == 0 for row, v in zip(rows, values, strict=True)]
    coupled = coupled_of(equations, 0.25)
    first = ParameterBox(("x", "y"), np.array([-4.0, -INF]), np.array([INF, 5.0]), ANY, ())
    s = 1 / max(abs(v) / F(c) for v, c in zip(at, scale, strict=True))
    phi = [s * v / F(c) for v, c in zip(at, scale, strict=True)]
    point = [*phi, noise, s]
    cube = cubes(coupled, first, np.array(scale))(3)
    for row in cube.rows:
        total = F(0)
        for word, value in zip(
            row.polynomial.words.tolist(), row.polynomial.coefficients, strict=True
        ):
            term = F(value)
            for letter in word:
                term *= point[letter - 1] if letter else 1
            total += term
        assert total == 0 if row.kind is sp.Kind.ZERO else total >= 0
    assert cube.lower[:2].tolist() == [-1, -1] and cube.upper.tolist() == [1, 1, 0.25, LARGEST]
    assert cube.lower[3] == 0.0
    side = next(2 * i + (v < 0) for i, v in enumerate(phi) if abs(v) == 1)
    problem = cube.side(side)
    where = np.array([float(v) for v in point]) / problem.units
    assert problem.problem.violation(where) <= 1e-9
    assert problem.problem.violation(np.where(np.arange(4) == side // 2, -where, where)) > 0.5


def test_rows_that_are_not_linear_or_bounded_do_not_suit():
    x, y, f = sp.variables(3, ["x", "y", "e"])
    assert suits(coupled_of([x + f * y == 1]))
    assert not suits(coupled_of([x * y + f == 1]))
    assert not suits(coupled_of([x * x + f == 1]))
    assert not suits(coupled_of([x + f == 1], reach=INF))
    assert not suits(coupled_of([x + 1e-260 * f == 1]))
    assert not suits(coupled_of([x + 1e260 * f == 1]))
    half = coupled_of([x + f == 1])
    low = np.array([-INF, -INF, -INF])
    problem = sp.Problem(x, half.problem.constraints, low, half.problem.upper)
    assert not suits(replace(half, problem=problem))


@pytest.mark.parametrize(
    "scale, exact",
    [
        ([1.0, 2.0], True),
        ([2.0**-60, 2.0**60], True),
        ([3.0, 1.0], False),
        ([1.0, -1.0], False),
        ([1.0, 0.0], False),
        ([1.0, INF], False),
        ([1.0, np.nan], False),
        ([1.0, 2.0**80], False),
        ([1.0, 2.0**-80], False),
        ([1.0], False),
    ],
)
def test_units_are_powers_of_two_and_ordinary(scale, exact):
    assert exact_units(np.array(scale), 2) == exact


def test_bounds_of_directions_are_rounded_outwards():
    """|theta| <= c / s beside what is known already."""
    first = ParameterBox(("x", "y"), np.array([-1.0, -INF]), np.array([INF, 0.125]), ANY, ())
    for least in (3.0, 0.1, 1 / 3, 1e-9):
        low, high = within(first, np.array([1.0, 4.0]), least)
        assert F(high[0]) >= 1 / F(least) and F(low[1]) <= -4 / F(least)
        assert low[0] == max(-1.0, -np.nextafter(1 / least, INF)) and high[1] == 0.125
