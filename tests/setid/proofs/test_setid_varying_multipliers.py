"""Multipliers that vary over a cone: by hand, by naive sums, planted records, forged claims."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
from setid.minimum_noise.claims import FoundDenominators
from setid.minimum_noise.cones.search import follow_denominators
from setid.minimum_noise.programs import Programs, longest_stretches
from setid.proofs.denominators.cones import first_cones
from setid.proofs.denominators.denominator_cells import Cell, DenominatorCells, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.denominators.varying_multipliers import VaryingCells, hurwitz_minors, pairs
from sparsepop_py.budget import Deadline

FIRST = setid.TransferFunction(na=1, nb=1, nk=1)
THIRD = setid.TransferFunction(na=3, nb=1, nk=1)
TRUTH = np.array([1.0, -1.5, 0.9, -0.2])


def stated(data: setid.IOData, model: setid.TransferFunction, size: float) -> setid.Formulation:
    return setid.formulate(data, model, setid.Noise(output=size), [setid.Stable()])


def planted() -> setid.IOData:
    """Order 3, poles inside the disc, output noise within .2."""
    random = np.random.default_rng(1)
    u, x = np.sign(random.uniform(-1.0, 1.0, 40)), np.zeros(40)
    for k in range(1, 40):
        x[k] = u[k - 1] - sum(TRUTH[i] * x[k - i] for i in range(1, min(k, 3) + 1))
    return setid.IOData(u, x + random.uniform(-0.2, 0.2, 40))


def least_for(data: setid.IOData, a: np.ndarray) -> float:
    """Least output noise with a given denominator, nb = 1, nk = 1: a program in all noise."""
    y, u, n, count = data.y[:, 0], data.u[:, 0], len(a) - 1, data.samples
    rows, right = np.zeros((count - n, count + 2)), np.zeros(count - n)
    for row, k in enumerate(range(n, count)):
        rows[row, k - n : k + 1], rows[row, count] = a[::-1], u[k - 1]
        right[row] = a[::-1] @ y[k - n : k + 1]
    one = np.hstack([np.eye(count), np.zeros((count, 1)), -np.ones((count, 1))])
    two = np.hstack([-np.eye(count), np.zeros((count, 1)), -np.ones((count, 1))])
    found = linprog(
        np.append(np.zeros(count + 1), 1.0),
        A_ub=np.vstack([one, two]),
        b_ub=np.zeros(2 * count),
        A_eq=rows,
        b_eq=right,
        bounds=[(None, None)] * (count + 2),
    )
    return float(found.fun)


@pytest.fixture(scope="module")
def search() -> tuple[setid.IOData, FoundDenominators]:
    data = planted()
    rows = output_rows(stated(data, THIRD, 1.0), 0)
    assert rows is not None
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    deadline = Deadline(60.0)
    return data, follow_denominators(rows, programs, 0, 0.1, deadline, [TRUTH[1:]])


# ---- by hand ------------------------------------------------------------------------------

BY_HAND = setid.IOData([0.0, 0.0, 1.0], [1.0, -1.0, -1.0])
TABLE = np.array([[0.0, -1.0, -1.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
CONSTANT, VARYING = (0, 0), (1, 2)


def by_hand(*families: tuple[int, ...], factor: float) -> bool:
    leaf = VaryingLeaf(families, (1.0,) * len(families), (0, 0))
    claim = VaryingCells(0, np.zeros(0, int), TABLE, (leaf,))
    return claim.verify(stated(BY_HAND, FIRST, factor))


def test_poles_by_hand() -> None:
    """y(k) + a y(k-1) = 0 with y = 1, -1, -1 and |a| <= 1.

    (-1, -1) gives 4 > 8 s at both (1, 1) and (1, -1) and 4 > 4 s for the pair; (0, -1) at (1, 1)
    with (-1, 0) at (1, -1) gives 4 > 4 s and 0 > 2 s. Together: 8 > 12 s and 4 > 6 s.
    """
    assert by_hand(CONSTANT, factor=0.499)
    assert not by_hand(CONSTANT, factor=0.501)
    assert not by_hand(VARYING, factor=0.01)
    assert by_hand(CONSTANT, VARYING, factor=0.666)
    assert not by_hand(CONSTANT, VARYING, factor=0.667)


def test_powers_scale_vectors_against_each_other() -> None:
    """With (1, 1) halved the pair says 1 + 2 > s (.5 + 1 + 1.5 + .5 + .5 + 1): 3 > 5 s."""
    for powers, factor in (((1, 0), 0.6), ((1, 1), 2.0 / 3.0)):
        leaf = VaryingLeaf((CONSTANT, VARYING), (1.0, 1.0), powers)
        claim = VaryingCells(0, np.zeros(0, int), TABLE, (leaf,))
        assert claim.verify(stated(BY_HAND, FIRST, factor - 1e-9))
        assert not claim.verify(stated(BY_HAND, FIRST, factor + 1e-9))


def test_gains_of_two_readings_by_hand() -> None:
    """y = b u with u = 1, 2 and y = 0, 3 needs noise of 1; off the columns costs what it is off."""
    data, model = setid.IOData([1.0, 2.0], [0.0, 3.0]), setid.TransferFunction(na=0, nb=1)
    leaf = VaryingLeaf(((0,),), (1.0,), (0,))
    off = 2.0**-20
    for table, good, bad in (([-2.0, 1.0], 0.999, 1.0), ([-2.0, 1.0 - off], 1 - 2 * off, 1 - off)):
        claim = VaryingCells(0, np.array([0]), np.array([table]), (leaf,))
        assert claim.verify(setid.formulate(data, model, setid.Noise(output=good)))
        assert not claim.verify(setid.formulate(data, model, setid.Noise(output=bad)))


def test_the_minor_of_a_cubic_by_hand() -> None:
    """(z - 1)^j (z + 1)^(3 - j) has b = e_j: b1 b2 - b0 b3 is 1 and -1 at two pairs, times 64."""
    minors = hurwitz_minors(first_cones(3, True)[0], (0, 0, 0, 0))
    expected = {(1, 2): 64.0, (0, 3): -64.0}
    assert minors.tolist() == [[expected.get(pair, 0.0) for pair in pairs(4)]]
    scaled = hurwitz_minors(first_cones(3, True)[0], (1, 0, 2, 0))
    expected = {(1, 2): 16.0, (0, 3): -32.0}
    assert scaled.tolist() == [[expected.get(pair, 0.0) for pair in pairs(4)]]


def test_minors_are_bilinear() -> None:
    """H(v + w) = H(v) + H(w) + what is said of the pair, with b from linear equations."""
    random, basis = np.random.default_rng(4), first_cones(3, True)[0].astype(float)
    for _ in range(10):
        cone = random.integers(-9, 10, (4, 4))
        minors = dict(zip(pairs(4), hurwitz_minors(cone.astype(object), (0,) * 4)[0], strict=True))

        def minor(a: np.ndarray) -> float:
            b = 8.0 * np.linalg.solve(basis.T, a)
            return float(b[1] * b[2] - b[0] * b[3])

        for j, k in pairs(4):
            expected = minor(cone[j] + cone[k]) - minor(cone[j]) - minor(cone[k])
            assert minors[j, k] == pytest.approx(expected, abs=1e-6)


def test_minors_are_nonnegative_at_stable_polynomials() -> None:
    random = np.random.default_rng(0)
    for _ in range(100):
        one, two = random.uniform(size=2) * np.exp(1j * random.uniform(0.0, np.pi, 2))
        a = np.real(np.poly([one, np.conj(one), two, np.conj(two)]))
        cone = np.array([np.round(2**30 * a).astype(int).tolist()] * 5, object)
        assert np.all(hurwitz_minors(cone, (30,) * 5) >= -1e-6)


# ---- naive sums ---------------------------------------------------------------------------


def naive_threshold(
    rows: OutputRows, table: np.ndarray, cone: np.ndarray, leaf: VaryingLeaf
) -> float:
    """The largest noise that a leaf refutes, from its definition."""
    b = cone.astype(float) @ first_cones(3, True)[0].astype(float)
    vectors = [cone[j].astype(float) / 2.0 ** leaf.powers[j] for j in range(4)]
    bilinear = [b[j] / 2.0 ** leaf.powers[j] for j in range(4)]
    least, count = np.inf, rows.y.size

    def value(v: np.ndarray, m: int) -> float:
        every = product(range(4), range(count))
        return sum(v[i] * table[m, k] * rows.y[k - i] for i, k in every if k >= i)

    def errors(v: np.ndarray, m: int) -> np.ndarray:
        padded = np.append(table[m], np.zeros(3))
        return np.array([sum(v[i] * padded[k + i] for i in range(4)) for k in range(count)])

    for j, k in pairs(4):
        need, give = 0.0, 0.0
        for family, share in zip(leaf.used, leaf.shares, strict=True):
            need += share * (value(vectors[j], family[k]) + value(vectors[k], family[j]))
            sums = errors(vectors[j], family[k]) + errors(vectors[k], family[j])
            give += abs(share) * float(np.abs(sums) @ rows.bound)
        one, two = bilinear[j], bilinear[k]
        (sigma,) = leaf.minors
        need -= sigma * (one[1] * two[2] + two[1] * one[2] - one[0] * two[3] - two[0] * one[3])
        least = min(least, need / give)
    return least


def test_leaves_refute_what_naive_sums_say() -> None:
    """Random families on the first cone: a little less noise is refuted, a little more is not."""
    random, cone, refuted = np.random.default_rng(3), first_cones(3, True)[0], 0
    none, apart = np.zeros((30, 0)), np.where(np.arange(30) % 9 == 3, 1.0, 0.0)
    for _ in range(80):
        y, bound = random.normal(size=30) + 20.0, random.uniform(0.5, 1.5, 30)
        rows = OutputRows(3, np.arange(30) >= 3, y, bound, none, True)
        table = np.where(rows.row, random.normal(size=(8, 30)), 0.0)
        table[:4] = apart * (1.0 + 0.01 * table[:4])  # refutes something at all pairs
        leaf = VaryingLeaf(
            used=((0, 1, 2, 3), tuple(random.permutation(8)[:4].tolist())),
            shares=(1.0, 0.001 * random.normal()),
            powers=tuple(random.integers(-1, 2, 4).tolist()),
            minors=(random.uniform(0.0, 0.001),),
        )
        least = naive_threshold(rows, table, cone, leaf)
        refuted += least > 0.0
        claim = VaryingCells(0, np.zeros(0, int), table, (leaf,))
        for factor in (1.0 - 1e-9, 1.0 + 1e-9) if least > 0.0 else ():
            assert claim.follows(rows._replace(bound=bound * (least * factor))) is (factor < 1.0)
    assert refuted > 5


# ---- planted records ----------------------------------------------------------------------

Search = tuple[setid.IOData, FoundDenominators]


def test_no_factor_is_above_that_of_any_denominator(search: Search) -> None:
    """The proved factor is below linear programs at sampled denominators, near the least one."""
    data, found = search
    random = np.random.default_rng(0)
    near = [TRUTH * (1.0 + random.uniform(-0.02, 0.02, 4)) for _ in range(10)]
    levels = [least_for(data, a / a[0]) for a in [TRUTH, *near, np.append(1.0, found.best[0])]]
    assert found.factor <= min(levels) <= 0.2  # the noise that was put in
    assert found.factor >= 0.85 * min(levels)
    assert found.cells is not None and isinstance(found.cells, VaryingCells)
    assert found.cells.verify(stated(data, THIRD, found.factor))
    assert not found.cells.verify(stated(data, THIRD, 1.001 * min(levels)))


def test_minors_leave_out_what_is_unstable(search: Search) -> None:
    """A cone around z^3 + 8 needs no multiplier; without the prior it does."""
    data, found = search
    assert found.cells is not None
    rows = output_rows(stated(data, THIRD, found.factor), 0)
    assert rows is not None
    none = np.zeros((0, data.samples))
    claim, poly = VaryingCells(0, found.cells.free, none, ()), np.array([1, 0, 0, 8])
    outside = np.array([(4 * poly + e).tolist() for e in np.eye(4, dtype=int)], object)  # at -2
    inside = np.array([(4 * poly[::-1] + e).tolist() for e in np.eye(4, dtype=int)], object)

    def refutes(cone: np.ndarray, minor: float, stable: bool = True, power: int = 0) -> bool:
        own = VaryingLeaf((), (), (power,) * 4, (minor,))
        return claim._refutes(rows._replace(stable=stable), none, none, cone, own)

    assert refutes(outside, 1.0) and not refutes(inside, 1.0)
    assert not refutes(outside, 1.0, stable=False)
    assert not refutes(inside, -1.0)
    assert not refutes(outside, 0.0)
    far = outside * 2**390
    assert refutes(outside, 1.0, power=-290) and refutes(far, 1.0, power=400)
    assert not refutes(far, 1.0, power=401)


def test_forged_leaves_are_refused(search: Search) -> None:
    data, found = search
    assert found.cells is not None
    good, cells = stated(data, THIRD, found.factor), list(found.cells.cells)
    at, leaf = next((n, c) for n, c in enumerate(cells) if isinstance(c, VaryingLeaf) and c.used)
    first, rest, count = leaf.used[0], leaf.used[1:], len(found.cells.multipliers)
    forged: list[Cell | VaryingLeaf] = [
        Cell(),
        leaf._replace(used=((count, *first[1:]), *rest)),
        leaf._replace(used=((-1, *first[1:]), *rest)),
        leaf._replace(used=(first[:-1], *rest)),
        leaf._replace(used=(*leaf.used, first)),
        leaf._replace(powers=leaf.powers[:-1]),
        leaf._replace(minors=(*leaf.minors, 1.0)),
        leaf._replace(shares=(float("nan"), *leaf.shares[1:])),
        leaf._replace(shares=tuple(-share for share in leaf.shares)),
    ]
    for other in forged:
        claim = replace(found.cells, cells=(*cells[:at], other, *cells[at + 1 :]))
        assert not claim.verify(good)
    table = found.cells.multipliers
    assert not DenominatorCells(0, found.cells.free, table, found.cells.cells).verify(good)
    assert not replace(found.cells, multipliers=table + 1e-3 * np.abs(table).max()).verify(good)
