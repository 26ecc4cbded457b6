"""Checks of directions, sums of products and far faces, one function at a time.

The proofs are those of a stranger who states every part himself, so that only the check that is
meant can refuse them. Each record has a consistent point by hand, in rationals.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.certificate.certificate import Certificate, Node
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox, cubes
from sparsepop_py.verified.uncertain_rows.lifted_products import lifted_rows, shrunk
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox
from sparsepop_py.verified.uncertain_rows.unbounded_coefficients import CoefficientLimit, Faces

INF = np.inf
ANY = np.array([[-INF], [INF]])


def coupled_of(equations, lower, upper, parameters):
    first = sp.variables(len(lower))[0]
    problem = sp.Problem(first, equations, np.array(lower), np.array(upper))
    count = len(lower)
    return CoupledRows(problem, parameters, np.ones(len(equations), bool), np.zeros(count))


# ---- directions: x + e = 1 with |e| <= 1/4, so that x lies in [3/4, 5/4] ---------------------


def single():
    x, e = sp.variables(2, ["x", "e"])
    coupled = coupled_of([x + e == 1], [-INF, -0.25], [INF, 0.25], 1)
    return UncertainRows(("x",), [-1.0], [[1.0]], [0.25], [[0.0]]), coupled


def box_of(low, high, start=ANY):
    return ParameterBox(("x",), np.array([low]), np.array([high]), start, ())


def direction(coupled, scale, first, reach, sides=2):
    """A box |x| <= reach, within ``first``, by propagation on the sides of the cube."""
    scale = np.array([scale])
    proofs = []
    for number in range(sides):
        problem = cubes(coupled, first, scale)(1).side(number).problem
        steps = BoxProof((Propagation(60, False),))
        proof = Certificate(problem.fingerprint, INF, Node(steps))
        proofs.append(replace(proof, bound=proof.recompute(problem)[0]))
    low, high = max(-reach, first.lower[0]), min(reach, first.upper[0])
    last = box_of(low, high)
    return DirectionBox(
        ("x",), last.lower, last.upper, first, scale, tuple(proofs), (1,) * sides, last
    )


def test_units_that_are_no_powers_of_two_are_refused():
    """Ranges give s >= 2/3 c on the only side with points, whatever c: |x| <= 3/2."""
    rows, coupled = single()
    for scale, holds in ((1.0, True), (0.5, True), (1.5, False), (2.0**-80, False)):
        found = direction(coupled, scale, box_of(-INF, INF), 1.6)
        assert found.verify(rows, coupled, ANY) == holds


def test_the_first_box_is_replayed():
    """x = 1 is consistent: nobody may begin with x >= 1.2."""
    rows, coupled = single()
    assert not direction(coupled, 1.0, box_of(1.2, INF), 1.6).verify(rows, coupled, ANY)


def test_every_side_needs_its_certificate():
    """Without any certificate abs(x) <= 1/4 would follow, and x = 1 is consistent."""
    rows, coupled = single()
    assert not direction(coupled, 1.0, box_of(-INF, INF), 0.25, 0).verify(rows, coupled, ANY)
    assert not direction(coupled, 1.0, box_of(-INF, INF), 1.6, 1).verify(rows, coupled, ANY)


def test_signs_hold_at_every_size():
    """x = 3/4 >= 1/2 and y = 8: phi = (3/32, 1) and s = 1/8, and 3/32 >= (1/2) s."""
    x, y, e = sp.variables(3, ["x", "y", "e"])
    coupled = coupled_of([x + y + e == 8.75], [-INF, -INF, -1.0], [INF, INF, 1.0], 2)
    first = ParameterBox(("x", "y"), np.array([0.5, 0.5]), np.array([INF, 9.0]), ANY, ())
    point = [Fraction(3, 32), Fraction(1), Fraction(0), Fraction(1, 8)]
    rows = cubes(coupled, first, np.ones(2))(1).rows
    assert len(rows) == 4
    for row in rows:
        total = Fraction(0)
        for word, value in zip(
            row.polynomial.words.tolist(), row.polynomial.coefficients, strict=True
        ):
            term = Fraction(value)
            for letter in word:
                term *= point[letter - 1] if letter else 1
            total += term
        assert total == 0 if row.kind is sp.Kind.ZERO else total >= 0


# ---- sums of products -------------------------------------------------------------------------


@pytest.mark.parametrize("sharper, low", [(1.5, 0.75), (-99.0, 0.5), (None, 0.5)])
def test_the_better_of_two_bounds_of_a_sum_counts(sharper, low):
    """b0 g + b1 g in [1, 2] and 1 + a = 2: g in [1/2, 1], or [3/4, 1] where the sum is >= 3/2."""
    names = ("b0*g", "b1*g", "a")
    regression = UncertainRows(names, [0.0], [[1.0, 1.0, 1.0]], [1.0], [[0.0, 0.0, 0.0]])
    columns = (((0, 3),), ((1, 3),), ((2,),))
    rows = ProductRows(regression, columns, ("b0", "b1", "a", "g"), (((0, 1), (2,)),))
    assert rows.sums == (((0, 3), (1, 3)),)
    ends = np.array([[-10.0, -10.0, 1.0], [10.0, 10.0, 1.0]])
    found = ParameterBox(names, *ends, ends, ())
    sums = tuple(LinearBound("OPTIMAL", v, v, None, ()) for v in (1.0, -2.0))
    proof = None if sharper is None else Certificate("", sharper, Node())
    box = shrunk(rows, np.array([[-INF] * 4, [INF] * 4]), found, sums, (proof, None))
    assert box[0, 3] <= low and box[1, 3] >= 1.0
    assert box[:, 3] == pytest.approx([low, 1.0])


def test_widths_of_many_small_numbers_are_rounded_upwards():
    """|p| + twenty times 2^-54: each of them disappears when it is added to 1."""
    x, p, *small = sp.variables(22)
    row = x + p * x
    for q in small:
        row = row + 2.0**-54 * q * x
    ones = np.append(INF, np.ones(21))
    rows = lifted_rows(coupled_of([row == 1], -ones, ones, 1), ("x",)).regression
    assert Fraction(rows.radii[0, 0]) >= 1 + 20 * Fraction(1, 2**54)


# ---- far faces: b g + e = 1, b h + e = -1 -----------------------------------------------------


def far_faces(extra=(), ends=None, low=-0.1, high=0.1):
    """Faces where g and h, both multiplied by b, have no bounds."""
    b, g, h, e = sp.variables(4, ["b", "g", "h", "e"])
    equations = [b * g + e == 1, b * h + e == -1, *(make(b, g, h, e) for make in extra)]
    lower, upper = [-INF] * 3 + [low], [INF] * 3 + [high]
    coupled = coupled_of(equations, lower, upper, 3)
    regression = UncertainRows(("b*g", "b*h"), [0.0], [[1.0, 1.0]], [1.0], [[0.0, 0.0]])
    rows = ProductRows(regression, (((0, 1),), ((0, 2),)), ("b", "g", "h"))
    ends = np.array([[0.9, -1.1], [1.1, -0.9]]) if ends is None else ends
    box = np.array([[-0.1, -INF, -INF], [0.6, INF, INF]])
    return coupled, rows, ends, box


def test_limits_are_of_the_parameters_that_were_proved(monkeypatch):
    """Proofs about g and h say nothing about b."""
    monkeypatch.setattr(Faces, "holds", lambda *_: True)
    for parameters, follows in (((1, 2), True), ((0, 2), False), ((0, 1), False), ((2, 1), False)):
        limit = CoefficientLimit(parameters, 4.0, (None, None))
        assert limit.follows(*far_faces()) == follows


@pytest.mark.parametrize("good", [1, 2])
def test_every_face_needs_its_proof(monkeypatch, good):
    monkeypatch.setattr(Faces, "holds", lambda self, face, reach, proof: face == good)
    assert not CoefficientLimit((1, 2), 4.0, (None, None)).follows(*far_faces())


def test_a_far_parameter_alone_is_not_expressed():
    """g + e = 3 is no row in c, s and phi."""
    assert Faces.of(*far_faces()) is not None
    assert Faces.of(*far_faces([lambda b, g, h, e: g + e == 3])) is None
    assert Faces.of(*far_faces([lambda b, g, h, e: e * g + b == 3])) is None


def test_numbers_that_are_known_exactly_make_no_face_empty():
    """e = 0: b = 1/8, g = 8 and h = -8 are consistent, and lie beyond a limit of 4."""
    faces = Faces.of(*far_faces(low=0.0, high=0.0))
    assert not faces.holds(1, 4.0, None) and not faces.holds(2, 4.0, None)


def test_faces_hold_both_signs_of_the_others():
    """b = 1/8, g = 8, h = -8: s = 1/8, c = 1, phi = (1, -1), and with both signs exchanged."""
    faces = Faces.of(*far_faces())
    box = faces.unknowns(1, 4.0)
    assert box[0, 0] <= 1.0 <= box[1, 0] and box[0, 1] <= 0.125 <= box[1, 1]
    assert box[0, 2] <= -1.0 <= box[1, 2]
    other = faces.unknowns(2, 4.0)
    assert other[0, 0] <= -1.0 <= other[1, 0] and other[0, 2] <= -0.125 <= other[1, 2]
    assert other[0, 1] <= -1.0 <= other[1, 1]
