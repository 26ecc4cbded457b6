"""Bands over time: replays in rationals, cells, roundings, and hostile helpers."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import setid
from setid.bands.branching import Effort, branched
from setid.feasible_set.proposer import Proposer
from setid.models.equations import Equation, Lagged, Term
from setid.proofs.cells.cells import Cells
from setid.proofs.supports import Cover, Proposal
from setid.proofs.time_bands import enclosures
from setid.proofs.time_bands.enclosures import Centre, Experiment, Frame, leak, noise_reach
from setid.proofs.time_bands.partition import Partition, Ranges
from setid.proofs.time_bands.rows import Affine, Known, OutputRow, output_row, transfer_row

Rational = list[Fraction]
FIRST = setid.TransferFunction(na=1, nb=1, nk=1)
SECOND = setid.TransferFunction(na=2, nb=2, nk=1, offset=True)
THETA = np.array([-1.2, 0.5, 1.0, 0.4, 0.3])


def box(centre: np.ndarray, width: float, rows: int = 0) -> Cover:
    """A box about a point, cut by rows that the point obeys."""
    rng = np.random.default_rng(7)
    matrix = rng.normal(size=(rows, centre.size))
    right = matrix @ centre + 0.3 * width * np.abs(matrix).sum(axis=1)
    names = tuple(f"t{i}" for i in range(centre.size))
    return Cover(names, centre - width, centre + width, matrix, right, True)


def members(cover: Cover, count: int = 40, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (4000 if cover.right.size else count, cover.lower.size)
    corners = np.where(rng.random(shape) < 0.5, cover.lower, cover.upper)
    found = np.where(rng.random(shape) < 0.5, corners, rng.uniform(cover.lower, cover.upper, shape))
    inside = [x for x in found if np.all(cover.matrix @ x <= cover.right)]
    assert len(inside) >= 10
    return inside[:count]


def experiment(
    model: setid.TransferFunction, samples: int, first: tuple[float, ...] = (), **noise: float
) -> Experiment:
    u = np.random.default_rng(3).uniform(-1, 1, (samples, 1))
    return Experiment(
        output_row(model.regression()[0], model.parameters),
        u,
        np.array(first),
        np.full(len(first), noise.get("start", 0.0)),
        np.full((samples, 1), noise.get("input", 0.0)),
        np.full(samples, noise.get("errors", 0.0)),
    )


def replayed(
    task: Experiment,
    theta: np.ndarray,
    start: np.ndarray | None = None,
    push: np.ndarray | None = None,
    errors: np.ndarray | None = None,
) -> Rational:
    """The output in rationals, noise added to the first outputs, the inputs and the equation."""
    exact = [Fraction(t) for t in theta.tolist()]
    n = len(task.u)
    u = [Fraction(x) for x in task.u[:, 0].tolist()]
    if push is not None:
        u = [a + Fraction(b) for a, b in zip(u, push.tolist(), strict=True)]
    y = [Fraction(x) for x in task.first.tolist()]
    if start is not None:
        y = [a + Fraction(b) for a, b in zip(y, start.tolist(), strict=True)]
    factors = {
        lag: Fraction(a.constant)
        + sum(Fraction(w) * t for w, t in zip(a.weights.tolist(), exact, strict=True))
        for lag, a in task.row.feedback.items()
    }
    for k in range(len(y), n):
        total = Fraction(0) if errors is None else Fraction(errors[k])
        for lag, factor in factors.items():
            if 0 < lag <= k:
                total -= factor * y[k - lag]
        for column, coefficient, inputs in task.row.others:
            if all(lag <= k for _, lag in inputs):
                value = math.prod((u[k - lag] for _, lag in inputs), start=Fraction(1))
                factor = Fraction(1) if column is None else exact[column]
                total -= factor * Fraction(coefficient) * value
        y.append(total / factors[0])
    return y


def holds(low: np.ndarray, high: np.ndarray, y: Rational) -> bool:
    return all(
        Fraction(a) <= v <= Fraction(b)
        for a, v, b in zip(low.tolist(), y, high.tolist(), strict=True)
    )


def bands(
    task: Experiment, cover: Cover, tolerance: float = 0.05, settle: int | None = None
) -> Ranges:
    found = branched(task, cover, Effort(tolerance, np.inf, 60), settle=settle)
    assert found.ranges is not None
    return found.ranges


@pytest.mark.parametrize("width", [0.0, 1e-9, 1e-3, 0.05])
@pytest.mark.parametrize("first", [(), (0.5, -0.25)])
def test_bands_hold_in_rationals(width: float, first: tuple[float, ...]) -> None:
    cover, task = box(THETA, width, rows=6 if width else 0), experiment(SECOND, 24, first)
    ranges = bands(task, cover)
    points = members(cover) if width else [THETA]
    for theta in points:
        assert holds(ranges.low, ranges.high, replayed(task, theta))
    if width <= 1e-9:
        assert np.max(ranges.high - ranges.low) < 1e-11 + 300 * width  # nothing but roundings


def test_a_point_costs_roundings_alone_on_a_slow_plant() -> None:
    """Poles .99, 200 samples, readings of size 100: the band of one point, in rationals."""
    theta = np.array([-1.98, 0.9801, 0.02, 0.01, 0.5])
    cover, task = box(theta, 0.0), experiment(SECOND, 200, (100.0, 101.0))
    ranges = bands(task, cover)
    assert holds(ranges.low, ranges.high, replayed(task, theta))
    assert np.max(ranges.high - ranges.low) < 1e-4


def test_noise_in_first_outputs_inputs_and_equations_is_covered() -> None:
    cover = box(THETA, 0.02)
    task = experiment(SECOND, 20, (0.5, -0.25), start=0.3, input=0.1, errors=0.2)
    ranges = bands(task, cover)
    rng = np.random.default_rng(1)
    for theta in members(cover, 25):
        start, push = rng.choice([-0.3, 0.3], 2), rng.choice([-0.1, 0.1], 20)
        errors = rng.choice([-0.2, 0.2], 20)
        assert holds(ranges.low, ranges.high, replayed(task, theta, start, push))
        driven = replayed(task, theta, start, push, errors)
        assert holds(ranges.driven_low, ranges.driven_high, driven)


def worst_noise(task: Experiment, theta: np.ndarray, place: int) -> tuple[np.ndarray, ...]:
    """Signs of all noises that move one sample up most, by differences of replays."""
    n, none = len(task.u), replayed(task, theta)[place]
    eye = np.eye(n)
    start = [replayed(task, theta, start=e)[place] > none for e in np.eye(task.first.size)]
    push = [replayed(task, theta, push=e)[place] > none for e in eye]
    errors = [replayed(task, theta, errors=e)[place] > none for e in eye]
    return tuple(np.where(s, 1.0, -1.0) for s in (start, push, errors))


def test_the_worst_noise_is_covered_and_nearly_attained() -> None:
    """The extreme of a linear function of bounded noise, found sign by sign in rationals."""
    cover = box(THETA, 1e-6)
    task = experiment(SECOND, 12, (0.5, -0.25), start=0.3, input=0.1, errors=0.2)
    ranges = bands(task, cover)
    for place in (3, 7, 11):
        start, push, errors = worst_noise(task, THETA, place)
        y = replayed(task, THETA, 0.3 * start, 0.1 * push)[place]
        assert y <= Fraction(ranges.high[place])
        # inputs before the first residual are bounded one by one, and they are few
        assert float(y) > ranges.high[place] - 0.2
        y = replayed(task, THETA, 0.3 * start, 0.1 * push, 0.2 * errors)[place]
        assert Fraction(ranges.high[place]) <= Fraction(ranges.driven_high[place])
        assert y <= Fraction(ranges.driven_high[place])


def test_cells_narrow_the_band_towards_what_is_attained() -> None:
    cover, task = box(THETA, 0.05), experiment(SECOND, 30)
    one = branched(task, cover, Effort(0.02, time.monotonic(), 1))
    many = branched(task, cover, Effort(0.02, np.inf, 400))
    assert one.ranges is not None and many.ranges is not None
    assert one.cells == 1 and many.cells > 10
    wide, narrow = (r.high - r.low for r in (one.ranges, many.ranges))
    assert np.all(narrow <= wide) and narrow.max() < 0.8 * wide.max()
    for theta in members(cover):
        assert holds(many.ranges.low, many.ranges.high, replayed(task, theta))


def test_the_first_cell_ends_with_the_time_and_holds() -> None:
    """Without any program the box bounds everything, more widely."""
    cover, task = box(THETA, 0.05, rows=6), experiment(SECOND, 12)
    found = branched(task, cover, Effort(0.02, -np.inf, first=-np.inf))
    whole = branched(task, cover, Effort(0.02, -np.inf))
    assert found.ranges is not None and whole.ranges is not None and found.cells == 1
    assert np.max(found.ranges.high - found.ranges.low) > np.max(
        whole.ranges.high - whole.ranges.low
    )
    for theta in members(cover):
        assert holds(found.ranges.low, found.ranges.high, replayed(task, theta))


@pytest.mark.parametrize("lead", [0.5, 0.0])
def test_coefficients_of_the_sample_itself_may_be_parameters(lead: float) -> None:
    """(1 + t0) y(k) + t1 y(k-1) = t2 u(k) + t0 as continuous-time structures have it."""
    weights = np.eye(3)
    row = OutputRow(
        {0: Affine(1.0, weights[0]), 1: Affine(-0.5, 2.0 * weights[1])},
        [Known(2, -1.0, ((0, 0),)), Known(0, -1.0, ())],
    )
    u = np.random.default_rng(2).uniform(-1, 1, (20, 1))
    task = Experiment(row, u, np.zeros(0), np.zeros(0), np.zeros((20, 1)), np.zeros(20))
    cover = box(np.array([lead, -0.1, 1.0]), 0.1)
    ranges = bands(task, cover)
    assert np.isfinite(ranges.low).all() and np.max(ranges.high - ranges.low) < 20.0
    for theta in members(cover):
        assert holds(ranges.low, ranges.high, replayed(task, theta))


PRODUCTS = OutputRow(
    {0: Affine(1.0, np.zeros(3)), 1: Affine(0.0, np.eye(3)[0])},
    [
        Known(1, -1.0, ((0, 1),)),
        Known(2, -2.0, ((0, 1), (0, 1))),
        Known(None, 0.3, ((0, 0), (0, 2))),
        Known(None, -0.5, ((0, 3),)),
    ],
)
PLANT = np.array([-0.7, 1.0, 0.4])


@pytest.mark.parametrize("first", [(), (0.5,)])
@pytest.mark.parametrize("push", [0.0, 0.1])
def test_products_of_inputs_and_known_terms_are_covered(
    first: tuple[float, ...], push: float
) -> None:
    """A map of the input in front of a pole, with noise in the input."""
    task = replace(experiment(SECOND, 24, first, start=0.2, input=push), row=PRODUCTS)
    cover = box(PLANT, 0.02)
    ranges = bands(task, cover)
    rng = np.random.default_rng(1)
    for theta in members(cover, 30):
        start, noise = rng.choice([-0.2, 0.2], len(first)), rng.choice([-push, push], 24)
        assert holds(ranges.low, ranges.high, replayed(task, theta, start, noise))
    u = task.u[:, 0]
    for sign in (-push, push):  # the noise that moves the squares most
        noise = sign * np.where(u < 0, -1.0, 1.0)
        assert holds(ranges.low, ranges.high, replayed(task, PLANT, None, noise))


def test_noise_of_products_costs_what_it_may_change() -> None:
    """y = 3 u^2, abs(u) = 2 and noise of .5: from 3 1.5^2 to 3 2.5^2, bounded by 12 +- 6.75."""
    row = OutputRow({0: Affine(1.0, np.zeros(1))}, [Known(0, -1.0, ((0, 0), (0, 0)))])
    task = replace(experiment(FIRST, 6, input=0.5), row=row, u=np.full((6, 1), -2.0))
    cover = box(np.full(1, 3.0), 0.0)
    ranges = one_cell(task, cover)
    assert ranges.high == pytest.approx(np.full(6, 18.75)) and np.all(ranges.high >= 18.75)
    assert ranges.low == pytest.approx(np.full(6, 5.25))
    still = one_cell(replace(task, input_noise=np.zeros((6, 1))), cover)
    assert still.low == pytest.approx(still.high, abs=1e-11)


def test_noise_of_an_input_without_a_parameter_is_covered() -> None:
    """y = 2 u(k-1) with noise of .5, from rest."""
    row = OutputRow({0: Affine(1.0, np.zeros(1))}, [Known(None, -2.0, ((0, 1),))])
    task = replace(experiment(FIRST, 4, input=0.5), row=row, u=np.ones((4, 1)))
    ranges = one_cell(task, box(np.ones(1), 0.0))
    assert ranges.high == pytest.approx([0, 3, 3, 3]) and np.all(ranges.high[1:] >= 3)
    assert ranges.low == pytest.approx([0, 1, 1, 1]) and np.all(ranges.low[1:] <= 1)


def test_sizes_of_residuals_hold_all_terms() -> None:
    """Their rounding is a share of it: abs(y) + .7 abs(y(k-1)) and each term of the inputs."""
    u, y = np.array([[1.0], [2.0], [-3.0], [0.5]]), np.array([1.0, -1.0, 2.0, 4.0])
    _, _, size = PRODUCTS.residual(y, u, box(PLANT, 0.0))
    last = 4 + 0.7 * 2 + 1.0 * 3 + 2 * 0.4 * 9 + 0.3 * 0.5 * 2 + 0.5 * 1
    assert size[3] == pytest.approx(last) and size[0] == 1.0
    kept = PRODUCTS.others
    assert (
        OutputRow(PRODUCTS.feedback, [*kept, Known(1, 1.0, ())]).without_constant().others == kept
    )


def test_rows_with_other_products_are_refused() -> None:
    own, other = (Term(1.0, (), (Lagged(f"y{i}"),)) for i in (1, 2))
    past = (Lagged("y1", 1), Lagged("u1", 1))
    cases = {
        "found products,": Term(1.0, ("a", "b"), (Lagged("u1"),)),
        "products with outputs": Term(1.0, ("a",), past),
        "coupled outputs": Term(1.0, ("a",), other.signals),
        "the signal z": Term(1.0, ("a",), (Lagged("z"),)),
    }
    for message, term in cases.items():
        with pytest.raises(setid.ModelError, match=message):
            output_row(Equation("y1", (own, term)), ("a", "b"))


def test_rows_of_one_input_are_those_of_its_transfer_function() -> None:
    model = setid.TransferFunction([[1, 2]], [[1, 2]], nk=1, inputs=2)
    theta = np.array([-0.7, -1.2, 0.5, 0.5, 0.2, 0.3])
    row = transfer_row(model.transfer(1, 2), 1, model.parameters)
    u = np.random.default_rng(0).uniform(-1, 1, (12, 2))
    none = np.zeros(0)
    task = Experiment(row, u, none, none, np.zeros((12, 2)), np.zeros(12))
    ranges = one_cell(task, box(theta, 0.0))
    y = setid.simulate(model, theta, u * [0.0, 1.0]).ravel()
    assert ranges.low == pytest.approx(y, abs=1e-9) and ranges.high == pytest.approx(y, abs=1e-9)


def test_unstable_members_are_covered_for_a_finite_time() -> None:
    theta = np.array([-2.1, 1.1025, 1.0, 0.4, 0.3])  # both poles at 1.05
    cover, task = box(theta, 0.02), experiment(SECOND, 40)
    ranges = bands(task, cover)
    assert np.isfinite(ranges.high).all()
    for theta in members(cover, 20):
        assert holds(ranges.low, ranges.high, replayed(task, theta))


@pytest.mark.parametrize("corner", [-1.0, 1.0])
def test_the_centre_may_be_a_corner_of_the_cell(corner: float) -> None:
    """Coordinates of one sign: the term of second order must have the right one."""
    cover, task = box(THETA, 0.02), experiment(SECOND, 24)
    theta = THETA + corner * 0.02
    part = Partition(task, cover, frame_of(2), Proposer(cover))
    outputs = np.array([float(v) for v in replayed(task, theta)])
    den = np.concatenate([[1.0], theta[:2]])
    impulse = np.zeros(24)
    impulse[0] = 1.0
    for k in range(1, 24):
        impulse[k] = -sum(den[i] * impulse[k - i] for i in (1, 2) if i <= k)
    part.enclose(0, Centre(theta, outputs, impulse), Proposer(part.polytope(0)))
    ranges = part.ranges()
    assert ranges is not None
    opposite = THETA - corner * 0.02
    for point in [opposite, *members(cover, 30)]:
        assert holds(ranges.low, ranges.high, replayed(task, point))


SLOWEST = np.array([-0.7, 1.0])  # of the poles from .3 to .7


def one_cell(task: Experiment, cover: Cover) -> Ranges:
    found = branched(task, cover, Effort(1e-9, time.monotonic() - 1.0, 1))
    assert found.ranges is not None and found.cells == 1
    return found.ranges


def test_all_orders_of_the_slowest_member_are_covered() -> None:
    """All terms of the series have one sign there, and each bound is attained by its term."""
    cover = Cover(("a1", "b1"), np.array([-0.7, 1.0]), np.array([-0.3, 1.0]), *no_rows(2), True)
    task = replace(experiment(FIRST, 16), u=np.ones((16, 1)))
    ranges = one_cell(task, cover)
    for a in (-0.7, -0.5, -0.3):
        assert holds(ranges.low, ranges.high, replayed(task, np.array([a, 1.0])))


def test_noise_in_the_first_output_meets_every_pole() -> None:
    cover = Cover(("a1", "b1"), np.array([-0.7, 1.0]), np.array([-0.3, 1.0]), *no_rows(2), True)
    task = experiment(FIRST, 16, (0.0,), start=10.0)
    ranges = one_cell(task, cover)
    for start in (-10.0, 10.0):
        assert holds(ranges.low, ranges.high, replayed(task, SLOWEST, np.array([start])))


def no_rows(p: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((0, p)), np.zeros(0)


def test_the_output_starts_from_readings_whatever_the_centre_says() -> None:
    cover, task = box(THETA, 0.0), experiment(SECOND, 16, (0.5, -0.25))
    outputs = np.array([float(v) for v in replayed(task, THETA)])
    outputs[:2] = 3.0, -4.0
    part = Partition(task, cover, frame_of(2), Proposer(cover))
    part.enclose(0, Centre(THETA, outputs, np.eye(1, 14)[0]), Proposer(part.polytope(0)))
    ranges = part.ranges()
    assert ranges is not None and holds(ranges.low, ranges.high, replayed(task, THETA))


def test_long_sums_that_cancel_are_rounded_outwards() -> None:
    """The free response of a slow oscillation, its coefficients known: h * r is all rounding."""
    radius, angle = 0.9999, 2 * np.pi / 150
    known = {0: 1.0, 1: -2 * radius * np.cos(angle), 2: radius**2}
    row = OutputRow(
        {lag: Affine(float(c), np.zeros(1)) for lag, c in known.items()},
        [Known(0, -1.0, ((0, 0),))],
    )
    for start in ((1e3, 1.1e3), (7.7, 8.1), (1.0 / 3.0, 0.2)):
        task = experiment(SECOND, 600, start)
        task = replace(task, row=row, u=np.zeros((600, 1)))
        ranges = one_cell(task, box(np.ones(1), 0.0))
        assert holds(ranges.low, ranges.high, replayed(task, np.ones(1)))
        assert np.max(ranges.high - ranges.low) < 1e-4 * abs(start[0])


# ---- the leak ---------------------------------------------------------------------------


class Hostile:
    """Multipliers that mean nothing, infinite and negative ones among them."""

    def __init__(self, cover: Cover) -> None:
        self.rows = len(cover.right)

    def multipliers(self, directions: np.ndarray) -> Iterator[Proposal]:
        rng = np.random.default_rng(5)
        places, rows = np.arange(len(directions)), np.arange(self.rows)
        for size in (0.01, 1.0):
            weights = size * rng.normal(size=(places.size, rows.size))
            weights[rng.random(weights.shape) < 0.05] = np.inf
            yield Proposal(places, rows, weights)


def frame_of(columns: int, lies: float = 0.0) -> Frame:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])[:columns, :columns]
    return Frame(np.arange(columns), turn, np.linalg.inv(turn) * (1.0 + lies))


@pytest.mark.parametrize("lies", [0.0, 0.3])
def test_the_leak_is_bounded_in_rationals(lies: float) -> None:
    """E = h D - 1 and its parts, with an h and a frame that are wrong."""
    cover, task = box(THETA, 0.05, rows=4), experiment(SECOND, 10)
    h = np.random.default_rng(0).normal(size=10)
    frame = frame_of(2, lies)
    part = Partition(task, cover, frame, Hostile(cover))
    cell = part.cell(0)
    middle = THETA + np.array([0.04, -0.03, 0.0, 0.0, 0.0])
    centre = Centre(middle, np.zeros(10), h)
    found = leak(task.row, frame, (cell.low, cell.high), cover, centre, Hostile)
    exact = [Fraction(x) for x in h.tolist()]
    for theta in members(cover, 20):
        one, two = (Fraction(t) for t in theta[:2].tolist())
        E = [
            exact[k]
            + (one * exact[k - 1] if k >= 1 else 0)
            + (two * exact[k - 2] if k >= 2 else 0)
            - (k == 0)
            for k in range(10)
        ]
        assert all(abs(e) <= Fraction(b) for e, b in zip(E, found.whole.tolist(), strict=True))
        moved = [t - Fraction(c) for t, c in zip((one, two), middle[:2].tolist(), strict=True)]
        s = [
            sum(Fraction(r) * t for r, t in zip(row, moved, strict=True))
            for row in frame.rows.tolist()
        ]
        slack = Fraction(1, 10**13)
        for j in range(2):
            assert (
                Fraction(found.spread[0, j]) - slack <= s[j] <= Fraction(found.spread[1, j]) + slack
            )
        rest = [
            E[k] - sum(s[j] * Fraction(found.slopes[j, k]) for j in range(2)) for k in range(10)
        ]
        bound = (found.rest + found.lost).tolist()
        assert all(abs(e) <= Fraction(b) + slack for e, b in zip(rest, bound, strict=True))


def test_hostile_helpers_cannot_break_a_band() -> None:
    cover, task = box(THETA, 0.03, rows=5), experiment(SECOND, 16, (0.5, -0.25), start=0.1)
    frame, rng = frame_of(2, 0.2), np.random.default_rng(4)
    part = Partition(task, cover, frame, Hostile(cover))
    _, second = part.cut(0, 0, float(part.cell(0).tight[0].mean()))
    part.cut(second, 1, float(rng.normal()))
    for number in part.numbers:
        source = Hostile(part.polytope(number))
        if part.tighten(number, source):
            theta = THETA + rng.normal(size=5) * 0.1
            part.enclose(
                number, Centre(theta, rng.normal(size=16), rng.normal(size=14) * 0.1), source
            )
    ranges = part.ranges()
    assert ranges is not None and np.isfinite(ranges.low).all()
    for theta in members(cover, 30):
        start = rng.choice([-0.1, 0.1], 2)
        assert holds(ranges.low, ranges.high, replayed(task, theta, start))


# ---- cells ------------------------------------------------------------------------------


def halves() -> tuple[Partition, Experiment, int, int]:
    cover, task = box(THETA, 0.05), experiment(SECOND, 8)
    part = Partition(task, cover, frame_of(2), Proposer(cover))
    low, high = part.cell(0).tight
    first, second = part.cut(0, 0, float(low[0] + 0.3 * (high[0] - low[0])))
    return part, task, first, second


def test_neighbours_share_the_number_that_parts_them() -> None:
    part, _, first, second = halves()
    assert part.cell(first).high[0] == part.cell(second).low[0]
    assert sorted(part.numbers) == sorted([first, second])
    assert part.cell(first).low[1] == part.cell(second).low[1]
    assert part.cell(first).high[1] == part.cell(second).high[1]


def test_cells_that_are_not_enclosed_keep_the_range_of_the_cell_they_come_from() -> None:
    part, _, first, _ = halves()
    number = first
    centre = Centre(THETA, np.zeros(8), np.eye(1, 8)[0])
    part.enclose(number, centre, Proposer(part.polytope(number)))
    ranges = part.ranges()
    assert ranges is not None and np.all(np.isinf(ranges.low))  # the other one is unknown
    known = part.range_of(first)
    for child in part.cut(first, 1, float(part.cell(first).tight[0].mean())):
        assert np.array_equal(part.range_of(child).low, known.low)


def test_a_cell_is_dropped_only_with_a_proof() -> None:
    part, _, first, second = halves()
    rows = len(part.polytope(first).right)
    assert not part.drop(first, np.ones(rows))  # it is not empty, whatever is said
    assert not part.drop(first, np.zeros(rows))
    far = part.cut(second, 1, 1e6)
    beyond = [n for n in far if part.cell(n).low[1] == 1e6][0]
    weights = np.zeros(len(part.polytope(beyond).right))
    weights[-1] = 1.0  # -s1 <= -1e6, on a box where s1 is at most 2
    assert not part.drop(beyond, 0.0 * weights)
    assert part.drop(beyond, weights) and beyond not in part.numbers


def test_tightening_drops_what_lies_outside() -> None:
    part, _, first, second = halves()
    far = part.cut(second, 1, 1e6)
    beyond = [n for n in far if part.cell(n).low[1] == 1e6][0]
    assert part.tighten(first, Proposer(part.polytope(first)))
    assert not part.tighten(beyond, Proposer(part.polytope(beyond)))
    assert beyond not in part.numbers and first in part.numbers


def test_a_contradiction_that_is_not_proved_keeps_the_cell() -> None:
    """Rows that miss each other by less than roundings: a program may call that empty."""
    third = 1.0 / 3.0
    matrix = np.array([[third, third], [-third, -third]])
    cover = Cover(("a", "b"), -np.ones(2), np.ones(2), matrix, np.array([0.1, -0.1]), True)
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    task = experiment(model, 6)
    part = Partition(task, cover, frame_of(1), Proposer(cover))
    closer = Cover(("a", "b"), -np.ones(2), np.ones(2), matrix, np.array([0.1, -0.1 - 1e-17]), True)
    assert part.numbers == [0]
    weights = Proposer(closer).contradiction()
    assert weights is None or not part.drop(0, np.append(weights, [0.0, 0.0]))
    assert part.numbers == [0]


def test_sets_without_points_end_without_a_band() -> None:
    matrix = np.array([[1.0, 1.0], [-1.0, -1.0]])
    cover = Cover(("a", "b"), -np.ones(2), np.ones(2), matrix, np.array([0.1, -0.2]), True)
    task = experiment(setid.TransferFunction(na=1, nb=1, nk=1), 6)
    assert branched(task, cover, Effort(0.1, np.inf, 20)).ranges is None


# ---- all time ---------------------------------------------------------------------------


def step(samples: int) -> Experiment:
    return replace(experiment(SECOND, samples), u=np.ones((samples, 1)))


def test_a_range_for_all_time_holds_and_has_the_static_gains() -> None:
    cover, task = box(THETA, 0.01), step(230)
    ranges = bands(task, cover, settle=50)
    assert np.isfinite(ranges.later).all() and np.ptp(ranges.later) < 1.0
    gains = []
    for theta in members(cover, 60):
        a, b = theta[:2], theta[2:4]
        gains.append((b.sum() + theta[4]) / (1 + a.sum()))
        y = setid.simulate(SECOND, theta, np.ones(600))[230:]
        assert np.all((y >= ranges.later[0]) & (y <= ranges.later[1]))
    assert np.ptp(ranges.later) < 1.6 * np.ptp(gains)


def test_no_range_for_all_time_without_a_proof() -> None:
    cover = box(THETA, 0.01)
    assert np.all(np.isinf(bands(step(230), cover).later))  # h does not end
    assert np.all(np.isinf(bands(step(60), cover, settle=50).later))  # too short to settle
    moving = experiment(SECOND, 230)
    assert np.all(np.isinf(bands(moving, cover, settle=50).later))  # the input moves
    slow = box(np.array([-2.0, 1.0, 1.0, 0.4, 0.3]), 0.01)  # a double pole at 1
    assert np.all(np.isinf(bands(step(230), slow, settle=50).later))


def test_noise_reaches_nothing_where_there_is_none() -> None:
    task = experiment(SECOND, 8, (0.5, -0.25))
    ends = THETA, THETA
    assert not np.any(noise_reach(task, ends, THETA, np.ones(6)))


@pytest.mark.parametrize("end", [0.0, 1e-290, 1e-45, 1e-20])
def test_small_ends_of_sequences_are_bounded_together(end: float) -> None:
    """Sums of products in rationals, of a sequence that falls below 2^-100 of its largest."""
    rng = np.random.default_rng(6)
    left = np.concatenate([0.1 * rng.random(8), end * rng.random(22)])
    right = rng.random(30)
    exact = [Fraction(x) for x in left], [Fraction(x) for x in right]
    found = enclosures._convolve_up(left, right)
    for k in range(30):
        whole = sum(exact[0][i] * exact[1][k - i] for i in range(k + 1))
        assert whole <= Fraction(found[k]) <= whole * (1 + Fraction(1, 10**10)) + 10**-280
    errors: Rational = []
    bounds = enclosures._with_leak(right, left)
    for k in range(30):
        past = sum((exact[0][i] * errors[k - i] for i in range(1, k + 1)), Fraction(0))
        errors.append((exact[1][k] + past) / (1 - exact[0][0]))
        assert errors[k] <= Fraction(bounds[k]) <= errors[k] * (1 + Fraction(1, 10**9))


def test_leaks_that_are_small_from_the_first_lag_on_add_up() -> None:
    """e(k) = 2^-109 (e(0) + ... + e(k-1)) behind e(0) = 2: nothing else hides what is lost."""
    tiny = Fraction(1, 2**110)
    bounds = enclosures._with_leak(np.eye(1, 5)[0], np.array([0.5, *[float(tiny)] * 4]))
    errors = [Fraction(2)]
    for _ in range(4):
        errors.append(2 * tiny * sum(errors))
    assert all(e <= Fraction(b) for e, b in zip(errors, bounds.tolist(), strict=True))
    assert np.all(bounds[1:] < 1e-32)


def test_sequences_with_numbers_that_overflowed_bound_nothing() -> None:
    for bad in (np.nan, np.inf):
        left, right = np.array([0.5, bad, 0.0, 0.0]), np.ones(4)
        assert not np.any(np.isfinite(enclosures._convolve_up(left, right)[1:]))
        assert not np.any(np.isfinite(enclosures._with_leak(right, left)[1:]))
        assert not np.any(np.isfinite(enclosures._convolved(left, right)[1:]))


def test_long_records_take_short_impulse_responses(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pole at 0.5 is below 2^-100 after 100 samples, however long the record is."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 2000)
    data = setid.simulate_record(FIRST, [-0.5, 1.0], u, setid.Noise(equation=0.1), seed=0).data
    result = setid.identify(data, FIRST, setid.Noise(equation=0.1))
    convolve, lengths = np.convolve, []

    def measured(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        lengths.append(left.size)
        return convolve(left, right)

    monkeypatch.setattr(np, "convolve", measured)
    band = result.simulate(tolerance=0.5)
    assert np.all(np.isfinite(band.high))
    assert lengths and np.median(lengths) < 130


def test_cells_are_dropped_by_a_proof_only() -> None:
    """Multipliers of zero prove 0 >= 0; the sum of both sides of a coordinate, its width."""
    cover = box(np.array([0.5, 1.0]), 0.25)
    cells = Cells(cover, np.eye(2), Proposer(cover))
    assert not cells.drop(0, np.zeros(4))
    assert not cells.drop(0, np.array([1.0, 0.0, 1.0, 0.0]))
    assert cells.numbers == [0]
