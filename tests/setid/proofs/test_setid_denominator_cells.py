"""Refuted noise by cones of denominators: by hand, against linear programs, and forged claims."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
from setid.minimum_noise.denominators import least_output_noise
from setid.models.lti import Form
from setid.proofs.denominators.cones import first_cones, split_cone
from setid.proofs.denominators.denominator_cells import (
    Cell,
    DenominatorCells,
    VaryingLeaf,
    _inverse,
    correction_bounds,
    is_refuted,
    multiplied_readings,
)
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from sparsepop_py.budget import Deadline

STATIC = setid.TransferFunction(na=0, nb=1)


def stated(
    data: setid.IOData, model: setid.TransferFunction, size: float, *priors: setid.Stable
) -> setid.Formulation:
    return setid.formulate(data, model, setid.Noise(output=size), list(priors))


def by_one(multiplier: list[float]) -> DenominatorCells:
    """The claim that one multiplier refutes a static gain."""
    only = Cell(used=(0,), shares=(1.0,))
    return DenominatorCells(0, np.array([0]), np.array([multiplier]), (only,))


def least_for(data: setid.IOData, a: list[float], bound: float = 1.0) -> float:
    """Least output noise with a given denominator, nb = 1, nk = 1: a program in all noise."""
    y, u, n, count = data.y[:, 0], data.u[:, 0], len(a), data.samples
    full = np.array([1.0, *a])
    rows = np.zeros((count - n, count + 2))
    right = np.zeros(count - n)
    for row, k in enumerate(range(n, count)):
        for i in range(n + 1):
            rows[row, k - i] += full[i]
            right[row] += full[i] * y[k - i]
        rows[row, count] = u[k - 1]
    sizes = np.hstack([np.eye(count), np.zeros((count, 1)), -bound * np.ones((count, 1))])
    other = np.hstack([-np.eye(count), np.zeros((count, 1)), -bound * np.ones((count, 1))])
    found = linprog(
        np.append(np.zeros(count + 1), 1.0),
        A_ub=np.vstack([sizes, other]),
        b_ub=np.zeros(2 * count),
        A_eq=rows,
        b_eq=right,
        bounds=[(None, None)] * (count + 2),
    )
    return float(found.fun)


def noisy(seed: int, count: int = 40) -> setid.IOData:
    random = np.random.default_rng(seed)
    u, y = random.uniform(-1.0, 1.0, count), np.zeros(count)
    for k in range(1, count):
        y[k] = 0.7 * y[k - 1] + u[k - 1]
    return setid.IOData(u, y + random.uniform(-0.2, 0.2, count))


def test_gains_of_two_readings_by_hand() -> None:
    """y = b u with u = 1, 2 and y = 0, 3: noise of 1 explains it with b = 1, less does not."""
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    claim = by_one([-2.0, 1.0])
    assert claim.verify(stated(data, STATIC, 0.999))
    assert not claim.verify(stated(data, STATIC, 1.0))
    assert not claim.verify(stated(data, STATIC, 1.001))
    assert not by_one([-2.0, 0.9]).verify(stated(data, STATIC, 0.999))


@pytest.mark.parametrize(("norm", "least"), [("linf", 1.0), ("l2", 3.0 / 5**0.5), ("l1", 1.5)])
def test_gains_of_two_readings_in_each_norm(norm: str, least: float) -> None:
    """(b, 3 - 2 b) is smallest at b = 1, 6/5 and 3/2; the multiplier is (-2, 1)."""
    rows = output_rows(stated(setid.IOData([1.0, 2.0], [0.0, 3.0]), STATIC, 1.0), 0)
    assert rows is not None

    def refuted(size: float) -> bool:
        at = rows._replace(bound=np.full(2, size), norm=norm)
        return by_one([-2.0, 1.0]).follows(at)

    assert refuted(0.999 * least) and not refuted(1.001 * least)


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
def test_noise_whose_squares_underflow_is_let_through(norm: str) -> None:
    """Readings of 1e-89, multipliers of 1e-88: the squares of their products are zero."""
    rows = output_rows(stated(setid.IOData([1.0, 2.0], [0.0, 3e-89]), STATIC, 1.0), 0)
    assert rows is not None
    least = {"linf": 1.0, "l2": 3.0 / 5**0.5, "l1": 1.5}[norm]
    at = rows._replace(bound=np.full(2, 1.001e-89 * least), norm=norm)
    assert not by_one([-2e-88, 1e-88]).follows(at)


def smallest(data: setid.IOData, a: list[float], norm: str) -> float:
    """Least error of a simulation with a given denominator, nb = 1, nk = 1, in another way."""
    n, count = len(a), data.samples
    columns = np.zeros((count, n + 1))
    columns[:n, :n] = np.eye(n)
    for k in range(n, count):
        columns[k] = -sum(a[i] * columns[k - 1 - i] for i in range(n))
        columns[k, n] += data.u[k - 1, 0]
    y = data.y[:, 0]
    if norm == "l2":
        return float(np.linalg.norm(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]))
    eye = np.eye(count)
    found = linprog(
        np.append(np.zeros(n + 1), np.ones(count)),
        A_ub=np.block([[columns, -eye], [-columns, -eye]]),
        b_ub=np.concatenate([y, -y]),
        bounds=[(None, None)] * (n + 1 + count),
    )
    return float(found.fun)


@pytest.mark.parametrize("norm", ["l2", "l1"])
@pytest.mark.parametrize("seed", range(3))
def test_no_factor_in_another_norm_is_above_that_of_any_denominator(norm: str, seed: int) -> None:
    data = noisy(seed)
    rows = output_rows(stated(data, setid.TransferFunction(1, 1, 1), 1.0), 0)
    assert rows is not None
    found = least_output_noise(rows._replace(norm=norm), 0, 1e-3, Deadline(20.0))
    assert found.cells is not None
    at = rows._replace(bound=np.full(data.samples, found.factor), norm=norm)
    assert found.cells.follows(at)
    assert not found.cells.follows(at._replace(bound=1.01 * at.bound))
    levels = [smallest(data, [a], norm) for a in np.linspace(-1.3, 1.3, 261)]
    assert min(levels) >= found.factor
    assert smallest(data, list(found.best[0]), norm) <= 1.01 * found.factor
    smaller = {"l2": "l1", "l1": "linf"}[norm]  # a smaller dual norm refutes more
    assert not found.cells.follows(at._replace(norm=smaller, bound=5.0 * at.bound))


def test_multipliers_off_the_columns_cost_what_they_are_off() -> None:
    """lambda = (-2, 1 - d): 3 - 3 d <= s (3 - d + 2 d) with a correction of 2 d at sample 0."""
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    off = 2.0**-20
    claim = by_one([-2.0, 1.0 - off])
    assert claim.verify(stated(data, STATIC, 1.0 - 2.0 * off))
    assert not claim.verify(stated(data, STATIC, 1.0 - 1.0 * off))


def test_corrections_are_exact_ones_and_rounding_at_most() -> None:
    """Two columns: the correction c at two samples solves known[free]' c = -known' lambda."""
    known = np.array([[1.0, 4.0], [0.0, 2.0], [3.0, 1.0], [1.0, 1.0]])
    rows = OutputRows(0, np.ones(4, bool), np.zeros(4), np.ones(4), known, False)
    multiplier = np.array([[0.0, 0.0, 0.1, -0.3]])
    found = correction_bounds(rows, np.array([0, 1]), multiplier)
    third, last = (Fraction(v) for v in multiplier[0, 2:].tolist())
    first = -(3 * third + last)  # 1 c0 + 0 c1, and 4 c0 + 2 c1
    second = (-(third + last) - 4 * first) / 2
    assert found is not None and found[0, 2:].tolist() == [0.0, 0.0]
    for bound, value in zip(found[0, :2].tolist(), (first, second), strict=True):
        assert abs(value) <= Fraction(bound) <= abs(value) + Fraction(1, 10**8)
    ones = rows._replace(known=np.ones((4, 1)))
    cancel = np.array([[0.0, 0.1, 0.2, -(0.1 + 0.2)]])  # the sum is 0 in doubles, and not in truth
    found = correction_bounds(ones, np.array([0]), cancel)
    truth = sum((Fraction(v) for v in cancel[0].tolist()), Fraction(0))
    assert found is not None and truth != 0 and Fraction(float(found[0, 0])) >= abs(truth)
    assert correction_bounds(ones._replace(row=np.arange(4) > 0), np.array([0]), cancel) is None


def test_what_is_lost_counts_for_each_coefficient() -> None:
    """y(k) + a y(k - 1) for a = -1, 1 with a multiplier that is off by d at the first row."""
    data = setid.IOData([1.0, 2.0, 2.0], [0.0, 0.0, 3.0])
    rows = output_rows(stated(data, STATIC, 1.0), 0)
    assert rows is not None
    rows = rows._replace(order=1, y=np.array([8.0, 0.0, 3.0]))
    multipliers, corrections = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.25, 0.0]])
    lost = multiplied_readings(rows, multipliers, corrections)[1]
    assert lost[0].tolist() == pytest.approx([0.25 * 1.0, 0.25 * 9.0])  # noise 1; 8 and noise 1
    cone = np.array([[0, 1]])
    rows = rows._replace(bound=np.zeros(3), y=np.array([8.0, 3.0, 0.0]))
    for size, refuted in ((0.25, True), (0.5, False)):  # 3 against 8 times the size
        off = np.array([[0.0, size, 0.0]])
        assert is_refuted(rows, multipliers, off, cone, np.ones(1)) == refuted


@pytest.mark.parametrize(
    "cell",
    [
        Cell(used=(0, 0), shares=(1.0,)),
        Cell(used=(-1,), shares=(1.0,)),
        Cell(used=(1,), shares=(1.0,)),
        Cell(),
        VaryingLeaf(((0,),), (1.0,), (0,)),
    ],
    ids=str,
)
def test_leaves_have_a_share_for_each_multiplier(cell: Cell | VaryingLeaf) -> None:
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    known = stated(data, STATIC, 0.9)
    assert by_one([-2.0, 1.0]).verify(known)
    claim = replace(by_one([-2.0, 1.0]), cells=(cell,))
    assert not claim.verify(known)


def test_claims_are_about_an_output_that_has_rows() -> None:
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    claim = by_one([-2.0, 1.0])
    for output in (-1, 1):
        assert not replace(claim, output=output).verify(stated(data, STATIC, 0.9))
    noise = setid.Noise(output=0.9, input=0.1)
    assert not claim.verify(setid.formulate(data, STATIC, noise))


def test_tiny_multipliers_whose_products_lose_their_digits_prove_nothing() -> None:
    """5e-324 times a reading of 2.6 is 3 times 5e-324, so that 2.6 would count as 3."""
    data = setid.IOData([1.0, 2.0], [0.0, 2.6])  # noise of 2.6 / 3 explains it
    only = Cell(used=(0,), shares=(2.0**600,))
    for size in (2.0**-1074, 2.0**-400, 2.0**400):
        claim = DenominatorCells(0, np.array([0]), size * np.array([[-2.0, 1.0]]), (only,))
        assert not claim.verify(stated(data, STATIC, 0.9))
        assert not claim.verify(stated(data, STATIC, 0.5))
    small = setid.IOData([1.0, 2.0], [0.0, 2.6 * 2.0**-400])
    assert not by_one([-2.0, 1.0]).verify(stated(small, STATIC, 0.5 * 2.0**-400))
    steep = setid.IOData([2.0**-400, 2.0**-399], [0.0, 3.0])
    assert not by_one([-2.0, 1.0]).verify(stated(steep, STATIC, 0.5))


def test_inverses_whose_entries_underflow_are_none() -> None:
    large, small = 2.0**300, 2.0**-300
    assert _inverse(np.array([[large, small], [0.0, large]])) is None
    assert _inverse(np.array([[large, large], [large, large]])) is None
    found = _inverse(np.array([[2.0, 1.0], [0.0, 4.0]]))
    assert found is not None and found.tolist() == [[0.5, -0.125], [0.0, 0.25]]


def test_many_shares_cost_their_rounding() -> None:
    """The sum of 2^14 equal numbers may be wrong by 2^-40 of itself and proves less."""
    data = setid.IOData([1.0, 2.0], [0.0, 3.0])
    count = 2**14
    only = Cell(used=(0,) * count, shares=(1.0,) * count)
    claim = DenominatorCells(0, np.array([0]), np.array([[-2.0, 1.0]]), (only,))
    assert claim.verify(stated(data, STATIC, 1.0 - 1e-10))
    assert not claim.verify(stated(data, STATIC, 1.0 - 2.5e-12))


def test_a_cell_serves_once() -> None:
    data = setid.IOData([0.0, 0.0, 1.0], [1.0, -1.0, -1.0])
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    leaf = Cell(used=(0,), shares=(-1.0,))
    table, stable = np.array([[0.0, 1.0, 1.0]]), stated(data, model, 0.4, setid.Stable())
    twice = (Cell((1, 1), (0, 1)), leaf)
    assert not DenominatorCells(0, np.zeros(0, int), table, twice).verify(stable)
    once = (Cell((1, 2), (0, 1)), leaf, leaf)
    assert DenominatorCells(0, np.zeros(0, int), table, once).verify(stable)


def test_poles_by_hand() -> None:
    """y(k) + a y(k-1) = 0 with y = 1, -1, -1: |a| <= 1 needs noise of 1, by [1, a] on rows 1, 2.

    Multipliers (1, 1) let through |eta(2)| + |1 + a| |eta(1)| + |a| |eta(0)| of -2 - 0 a.
    """
    data = setid.IOData([0.0, 0.0, 1.0], [1.0, -1.0, -1.0])
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    only = Cell(used=(0,), shares=(-1.0,))  # at (1, 1): 2 > 4 s; at (1, -1): 2 > 2 s
    claim = DenominatorCells(0, np.zeros(0, int), np.array([[0.0, 1.0, 1.0]]), (only,))
    stable = setid.Stable()
    assert claim.verify(stated(data, model, 0.499, stable))
    assert not claim.verify(stated(data, model, 0.501, stable))
    assert not claim.verify(stated(data, model, 0.499))  # that has two cones


def test_no_factor_is_above_that_of_any_denominator() -> None:
    """The proved factor is below linear programs over a grid, and near the least of them."""
    for seed in (1, 2):
        data, model = noisy(seed), setid.TransferFunction(na=1, nb=1, nk=1)
        rows = output_rows(stated(data, model, 1.0), 0)
        assert rows is not None
        found = least_output_noise(rows, 0, 0.02, Deadline(30.0))
        grid = min(least_for(data, [a]) for a in np.linspace(-0.9, -0.5, 81))
        assert found.cells is not None
        assert 0.97 * grid <= found.factor <= grid
        assert found.cells.verify(stated(data, model, found.factor))
        assert not found.cells.verify(stated(data, model, 1.05 * found.factor))


def test_second_order_and_several_leaves() -> None:
    data, model = noisy(3), setid.TransferFunction(na=2, nb=1, nk=1)
    rows = output_rows(stated(data, model, 1.0, setid.Stable()), 0)
    assert rows is not None and rows.stable
    found = least_output_noise(rows, 0, 0.1, Deadline(30.0))
    assert found.cells is not None and found.cells.leaves > 3
    good = stated(data, model, found.factor, setid.Stable())
    assert found.cells.verify(good)
    assert found.factor <= min(least_for(data, [*a]) for a in found.best)
    cells = list(found.cells.cells)
    for number, cell in enumerate(cells):
        if cell.children:
            swapped = cell._replace(children=(cell.children[0], cell.children[0]))
            forged = (*cells[:number], swapped, *cells[number + 1 :])
            assert not replace(found.cells, cells=tuple(forged)).verify(good)
            break
    leaf = next(number for number, cell in enumerate(cells) if not cell.children)
    bare = (*cells[:leaf], Cell(), *cells[leaf + 1 :])
    assert not replace(found.cells, cells=tuple(bare)).verify(good)
    cyclic = cells[0]._replace(children=(0, 0))
    assert not replace(found.cells, cells=(cyclic, *cells[1:])).verify(good)


def test_there_are_as_many_cells_as_first_cones() -> None:
    """Of thirty poles there would be a billion."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 80)
    known = setid.formulate(setid.IOData(u, u), setid.TransferFunction(30, 1), setid.Noise(0.1))
    assert not DenominatorCells(0, [40], np.zeros((1, 80)), (Cell(),)).verify(known)


def test_weights_on_an_edge_are_positive_integers() -> None:
    cone = first_cones(1, True)[0]
    halves = split_cone(cone, (0, 1), (1, 3))
    assert halves is not None
    assert [half.tolist() for half in halves] == [[[2, -1], [1, -1]], [[1, 1], [2, -1]]]
    for edge, weights in (((0, 0), (1, 1)), ((0, 2), (1, 1)), ((0, 1), (0, 1)), ((0, 1), (2, -1))):
        assert split_cone(cone, edge, weights) is None


def test_first_cones_hold_all_denominators() -> None:
    """Random polynomials with zeros in the disc lie in the first cone, all others in some."""
    random = np.random.default_rng(0)
    for _ in range(50):
        angle = random.uniform(0.0, np.pi)
        zeros = [random.uniform(-1.0, 1.0), *(random.uniform() * np.exp([1j * angle, -1j * angle]))]
        a = np.real(np.poly(zeros))
        shares = np.linalg.solve(first_cones(3, True)[0].T.astype(float), a)
        assert np.all(shares >= -1e-12)
        b = random.normal(size=4)
        held = [
            np.all(share >= 0) or np.all(share <= 0)
            for cone in first_cones(3, False)
            for share in [np.linalg.solve(cone.T.astype(float), b)]
        ]
        assert any(held)


@pytest.mark.parametrize("gap", [5, 20])
def test_missing_readings_and_records_leave_rows_out(gap: int) -> None:
    data = noisy(4)
    y = data.y.copy()
    y[gap] = np.nan
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    rows = output_rows(stated(setid.IOData(data.u, y), model, 1.0), 0)
    assert rows is not None
    assert np.flatnonzero(~rows.row).tolist() == [0, gap, gap + 1]
    two = setid.IOData.concat([data, data])
    both = output_rows(stated(two, model, 1.0), 0)
    assert both is not None and np.flatnonzero(~both.row).tolist() == [0, 40]


@pytest.mark.parametrize("offset", [False, True])
def test_rows_at_rest_hold_for_what_is_simulated_from_rest(offset: bool) -> None:
    """In rationals, from the first sample of each of two records on, with a lost reading."""
    rng, lengths = np.random.default_rng(8), (7, 6)
    u = [[Fraction(int(v), 4) for v in rng.integers(-4, 5, n)] for n in lengths]
    a, b, c = (Fraction(-3, 2), Fraction(3, 4)), (Fraction(2), Fraction(-1)), Fraction(int(offset))
    y: list[list[Fraction]] = []
    for drive in u:
        own: list[Fraction] = []
        for k in range(len(drive)):
            past = [-a[i - 1] * own[k - i] for i in (1, 2) if k >= i]
            own.append(sum(past + [b[j] * drive[k - 3 - j] for j in (0, 1) if k >= 3 + j], c))
        y.append(own)
    model = setid.TransferFunction(na=2, nb=2, nk=3, initial="zero", offset=offset)
    known = setid.IOData.concat(
        [
            setid.IOData([*map(float, one)], [*map(float, two)])
            for one, two in zip(u, y, strict=True)
        ]
    )
    rows = output_rows(stated(known, model, 1.0), 0)
    assert rows is not None and rows.sample is not None
    assert rows.sample.tolist() == [-1, -1, *range(7), -1, -1, *range(7, 13)]
    assert np.array_equal(rows.row, rows.sample >= 0)
    assert not np.any(rows.y[~rows.inside]) and not np.any(rows.bound[~rows.inside])
    assert np.all(rows.bound[rows.inside] == 1.0)
    gains = {"b3": b[0], "b4": b[1], "c": c}
    for k in np.flatnonzero(rows.row):
        left = sum(
            (v * Fraction(rows.y[k - i]) for i, v in enumerate((Fraction(1), *a))), Fraction(0)
        )
        pairs = zip(rows.gains, rows.known[k].tolist(), strict=True)
        assert left == sum((gains[name] * sign * Fraction(v) for (name, sign), v in pairs), 0)
    assert rows.sample[rows.begun].tolist() == [*range(2, 7), *range(9, 13)]
    gone = known.y.copy()
    gone[8] = np.nan
    parts = [setid.IOData(known.u[at], gone[at]) for at in (slice(7), slice(7, None))]
    left_out = output_rows(stated(setid.IOData.concat(parts), model, 1.0), 0)
    assert left_out is not None and left_out.sample is not None
    assert left_out.sample[~left_out.row & left_out.inside].tolist() == [8, 9, 10]


def test_noisy_inputs_and_equation_errors_are_not_taken() -> None:
    data, model = noisy(5), setid.TransferFunction(na=1, nb=1, nk=1)
    for noise in (setid.Noise(output=1.0, input=0.1), setid.Noise(output=1.0, equation=0.1)):
        assert output_rows(setid.formulate(data, model, noise), 0) is None


def test_multipliers_outside_of_rows_are_refused() -> None:
    """At sample 0 there is no row: y(0) + a y(-1) is asked of nobody."""
    data = setid.IOData([0.0, 0.0, 1.0], [5.0, 0.0, 0.0])
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    only = Cell(used=(0,), shares=(1.0,))
    claim = DenominatorCells(0, np.zeros(0, int), np.array([[1.0, 0.0, 0.0]]), (only,))
    assert not claim.verify(stated(data, model, 0.1, setid.Stable()))


def two_inputs(seed: int, count: int = 40) -> setid.IOData:
    """A sum of two systems of order 1, with noise of 0.05 on the output."""
    rng = np.random.default_rng(seed)
    model, u = setid.TransferFunction(1, 1, 1, inputs=2), rng.uniform(-1.0, 1.0, (count, 2))
    theta, noise = [-0.7, -0.4, 1.0, 0.6], setid.Noise(output=0.05)
    return setid.simulate_record(model, theta, u, noise, rng).data


@pytest.mark.parametrize("form", ["auto", "partial", "direct", "multiplied", "lifted"])
def test_rows_of_two_denominators_are_those_of_their_product(form: Form) -> None:
    """(1 - .7 w)(1 - .4 w) = 1 - 1.1 w + .28 w^2, and two values of each input on the right."""
    clean = two_inputs(0)
    model = setid.TransferFunction(1, 1, 1, inputs=2, form=form)
    y = setid.simulate(model, [-0.7, -0.4, 1.0, 0.6], clean.u)
    rows = output_rows(stated(setid.IOData(clean.u, y), model, 1.0), 0)
    assert rows is not None
    assert (rows.order, rows.known.shape, rows.stable) == (2, (40, 4), False)
    left = np.convolve(rows.y, [1.0, -1.1, 0.28])[:40]
    right = rows.known @ np.linalg.lstsq(rows.known, np.where(rows.row, left, 0.0), rcond=None)[0]
    assert np.allclose(left[rows.row], right[rows.row], atol=1e-12)


def test_rows_of_systems_at_rest_hold_for_an_offset_of_the_output() -> None:
    """Rows begin where all delayed samples are in the record: (1 - .7)(1 - .4) 2 = .36 there."""
    clean, theta = two_inputs(0), [-0.7, -0.4, 1.0, 0.6, 2.0]
    model = setid.TransferFunction(1, 1, 1, inputs=2, offset=True, initial="zero")
    y = setid.simulate(model, theta, clean.u)
    rows = output_rows(stated(setid.IOData(clean.u, y), model, 1.0), 0)
    assert rows is not None and rows.known.shape[1] == 5 and not np.any(rows.row[:2])
    left = np.where(rows.row, np.convolve(rows.y, [1.0, -1.1, 0.28])[:40], 0.0)
    found = np.linalg.lstsq(rows.known, left, rcond=None)[0]
    assert np.allclose(rows.known @ found, left, atol=1e-12)
    assert abs(found[-1] - 0.36) < 1e-9


def test_a_product_is_stable_where_each_denominator_is() -> None:
    """``Stable`` names all of them; a prior of one of two says nothing of the product."""
    lifted = setid.TransferFunction(1, 1, 1, inputs=2, form="lifted")

    class One(setid.Stable):
        def stable(self, model: setid.Structure) -> frozenset[tuple[str, ...]]:
            return frozenset([("a[1,1]1",)])

    for prior, expected in ((setid.Stable(), True), (One(), False)):
        rows = output_rows(stated(two_inputs(0), lifted, 1.0, prior), 0)
        assert rows is not None and rows.stable is expected


@pytest.mark.parametrize("seed", range(4))
def test_noise_that_two_inputs_need_is_not_refuted(seed: int) -> None:
    """The truth needs at most 0.05, and linear programs for its poles tell what it needs."""
    data = two_inputs(seed)
    lifted = setid.TransferFunction(1, 1, 1, inputs=2, form="lifted")
    rows = output_rows(stated(data, lifted, 1.0, setid.Stable()), 0)
    assert rows is not None
    found = least_output_noise(rows, 0, 0.05, Deadline(20.0))
    assert found.cells is not None and 0.02 < found.factor < 0.05
    assert found.cells.verify(stated(data, lifted, found.factor, setid.Stable()))
    assert not found.cells.verify(stated(data, lifted, 0.05, setid.Stable()))
