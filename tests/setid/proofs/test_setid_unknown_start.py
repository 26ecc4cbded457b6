"""Cells for records that do not begin at rest: rows free of the first sample, against rationals."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from slow_values import slow_after, slow_unless

import setid
from setid.models.checked_structures import equations_of
from setid.proofs.cells import cell_signals
from setid.proofs.cells.arithmetic import CellRows, Fitted
from setid.proofs.cells.output_cells import CellBox, cell_box, drive_of
from setid.proofs.cells.parts import can_start, parts_of, with_impulses
from setid.proofs.cells.unknown_start import depth, free_rows
from setid.proofs.parameter_box import start_of
from setid.proofs.simulated.outputs import recursion_from, recursion_of
from sparsepop_py.verified.arithmetic.interval import Interval

NOISE = 0.01
TRUTH = {"a[z,u1]1": -0.4, "a[y1,w]1": -0.5, "b[y1,w]1": 0.8, "gamma2": 0.3}
QUICK = setid.Options(tol=0.05, time_limit=60.0, progress=False)


def cascade(initial: str = "free", degree: int = 2, **options) -> setid.BlockStructured:
    """z = G u, w = z + gamma2 z^2 + ..., y = H w, both blocks of order one."""
    shape = setid.TransferFunction(1, 1, 1)
    blocks = {("z", "u1"): shape, ("y1", "w"): shape}
    names = ["b[z,u1]1", "gamma1"]
    maps = {"w": setid.StaticMap("z", degree)}
    return setid.BlockStructured(blocks, maps, normalise=names, initial=initial, **options)


def simulated(start: float, samples: int = 50, seed: int = 1, noise: float = NOISE):
    """A record of the cascade whose internal signal begins anywhere; and that signal."""
    random = np.random.default_rng(seed)
    u = random.uniform(-1.0, 1.0, samples)
    z, y = np.full(samples, start), np.full(samples, 0.2)
    for k in range(1, samples):
        z[k] = 0.4 * z[k - 1] + u[k - 1]
        y[k] = 0.5 * y[k - 1] + 0.8 * (z[k - 1] + 0.3 * z[k - 1] ** 2)
    return setid.IOData(u, y + noise * random.uniform(-1.0, 1.0, samples)), z


def formulated(data: setid.IOData, noise: float = NOISE, **options):
    return setid.formulate(data, cascade(**options), setid.Noise(output=noise), [setid.Stable()])


# ---- rows ---------------------------------------------------------------------------------

MAPS = {  # coefficients of z(k - lag)^power
    "Wiener": {(0, 1): "3/4", (0, 2): "-1/2"},
    "with a constant": {(0, 0): "1/3", (0, 1): "3/4", (0, 2): "-1/2"},
    "linear": {(1, 1): "3/4"},
    "two lags": {(1, 1): "3/4", (1, 2): "-1/2", (2, 1): "1/4", (2, 2): "-1/6"},
    "three lags": {(0, 2): "1/2", (1, 1): "3/4", (2, 1): "1/4", (2, 2): "-1/6"},
}


@pytest.mark.parametrize("pole", ["-1", "-3/8", "0", "7/8", "1"])
@pytest.mark.parametrize("start", [0, 3, -1000])
@pytest.mark.parametrize("name", MAPS)
def test_rows_hold_whatever_the_first_sample_is(name: str, start: int, pole: str) -> None:
    """Exact records without noise obey rows of cells around the pole, or at it."""
    gains = {key: Fraction(value) for key, value in MAPS[name].items()}
    a, behind = Fraction(pole), Fraction(-1, 2)
    random, samples = np.random.default_rng(3), 24
    drive = random.integers(-8, 9, samples) / 8.0
    drive[0] = 0.0
    z, y, f = [Fraction(start)], [Fraction(1)], [Fraction(0)]
    for k in range(1, samples):
        e = Fraction(float(drive[k]))
        z.append(-a * z[-1] + e)
        f.append(-a * f[-1] + e)
        mapped = sum(g * z[k - lag] ** p for (lag, p), g in gains.items() if k >= lag)
        y.append(-behind * y[-1] + mapped)
    lags = [lag for lag, _ in gains]
    rows = np.arange(1 + max(lags) + depth(lags), samples)
    exact = [Fraction(float(value)) for value in map(float, y)]
    rounded = max(abs(one - two) for one, two in zip(exact, y, strict=True))
    noise = np.full(samples, 2.0 * float(rounded) + 1e-30)
    for width in (0.0, 1e-6):
        low, high = float(a) - 0.25 * width, float(a) + 0.75 * width
        sure = np.abs(np.array([float(v) for v in f])) * 1e-15 + width * 50.0
        middle = np.array([float(v) for v in f])
        found = free_rows(
            Interval(np.array([[low]]), np.array([[high]])),
            Interval.point(drive[None]),
            Interval((middle - sure)[None], (middle + sure)[None]),
            rows,
            tuple(gains),
            1,
            np.array([float(v) for v in y]),
            noise,
            noise,
        )
        scaled = [(1 + a) * g if p == 1 else g for (_, p), g in gains.items()]
        theta = np.array([float(v) for v in (behind, *scaled)])
        assert found.shape is not None and found.shared is not None
        usable = np.isfinite(found.noise[0])
        assert np.count_nonzero(usable) >= 6
        off = np.abs(found.y[0] - found.matrix[0] @ theta)[usable]
        shared = np.abs(found.shape[0]) @ found.shared @ np.append(np.abs(theta), 1.0)
        room = (found.noise[0] + found.wide[0] @ np.abs(theta) + shared)[usable]
        assert np.all(off <= room)
        if width == 0.0:  # and say something: what they allow is rounding
            assert np.max(room) <= 1e-9 * (1.0 + start * start)


def made(pole: Interval, drive: Interval, signal: Interval, y, noise: float) -> CellRows:
    """Rows with a denominator behind the map, and two columns of one lag."""
    every, rows = np.full(y.size, noise), np.arange(6, y.size)
    return free_rows(pole, drive, signal, rows, ((1, 1), (1, 2)), 1, y, every, every)


def ends(values) -> Interval:
    return Interval.point(np.atleast_2d(np.asarray(values, float)))


def test_rows_of_a_cell_hold_those_of_its_points() -> None:
    random, samples = np.random.default_rng(4), 20
    y, drive = random.normal(size=samples), random.normal(size=(2, samples))
    signal = random.normal(size=(2, samples))
    wide = made(
        Interval(np.array([[-0.6]]), np.array([[-0.3]])),
        Interval(drive.min(axis=0)[None], drive.max(axis=0)[None]),
        Interval(signal.min(axis=0)[None], signal.max(axis=0)[None]),
        y,
        NOISE,
    )
    for share in (0.0, 0.3, 1.0):
        weights = np.array([share, 1.0 - share])
        point = made(
            ends(-0.6 + 0.3 * share), ends(weights @ drive), ends(weights @ signal), y, 0.0
        )
        assert np.all(np.abs(point.matrix - wide.matrix) <= wide.wide + 1e-9)
        assert np.all(np.abs(point.y - wide.y) <= wide.noise + 1e-9)
    narrow = made(ends(-0.45), ends(drive.mean(axis=0)), ends(signal.mean(axis=0)), y, NOISE)
    assert np.all(wide.noise > narrow.noise) and np.all(wide.wide > narrow.wide)


def test_drives_of_a_cell_hold_those_of_all_numerators_and_inputs() -> None:
    random = np.random.default_rng(6)
    cells, drives = np.sort(random.normal(size=(3, 2, 2)), axis=1), random.normal(size=(2, 5))
    spread = random.uniform(size=(2, 5))
    found = drive_of(cells, drives, spread)
    reached = []
    for shares in itertools.product([0.0, 1.0], repeat=4):
        numerator = cells[:, 0] + np.array(shares[:2]) * (cells[:, 1] - cells[:, 0])
        signs = 2.0 * np.array(shares[2:]) - 1.0
        reached.append(numerator @ (drives + signs[:, None] * spread))
        assert np.all((found.lo <= reached[-1]) & (reached[-1] <= found.hi))
    assert np.all(found.hi - np.max(reached, axis=0) < 1e-12)
    assert np.all(np.min(reached, axis=0) - found.lo < 1e-12)


@pytest.mark.parametrize("behind", [-0.9, 0.9])
def test_noise_of_past_readings_counts(behind: float) -> None:
    """The largest error of each combination, by the signs of the noise that make it."""
    random, samples = np.random.default_rng(5), 16
    drive, f, y = random.normal(size=samples), np.zeros(samples), np.zeros(samples)
    for k in range(1, samples):
        f[k] = 0.4 * f[k - 1] + drive[k]
        y[k] = -behind * y[k - 1] + f[k - 1] - 0.5 * f[k - 1] ** 2
    theta = np.array([behind, 0.6, -0.5])
    rows = made(ends(-0.4), ends(drive), ends(f), y, NOISE)
    assert rows.shape is not None and rows.shared is not None
    room = rows.noise[0] + np.abs(rows.shape[0]) @ rows.shared @ np.append(np.abs(theta), 1.0)
    for number, weights in enumerate(rows.shape[0]):
        of_noise = weights + behind * np.append(weights[1:], 0.0)
        noisy = y + NOISE * np.sign(of_noise)
        found = made(ends(-0.4), ends(drive), ends(f), noisy, NOISE)
        off = abs(found.y[0, number] - found.matrix[0, number] @ theta)
        assert off == pytest.approx(NOISE * np.abs(of_noise).sum(), abs=1e-9)
        assert off <= room[number] * (1.0 + 1e-9)


def test_errors_that_rows_share_are_counted_once() -> None:
    random = np.random.default_rng(0)
    shape, weights = random.normal(size=(2, 5, 8)), random.normal(size=(2, 3, 5))
    wide, noise = random.uniform(size=(2, 5, 2)), random.uniform(size=(2, 5))
    shared = random.uniform(size=(8, 3))
    rows = CellRows(np.zeros((2, 5, 2)), wide, np.zeros((2, 5)), noise, shape, shared)
    columns, readings = rows.errors(weights)
    for _ in range(200):  # extreme errors of the columns, and of the readings
        signs = np.sign(random.normal(size=(8, 3)))
        own = np.sign(random.normal(size=wide.shape)) * wide
        moved = np.einsum("ckt,tm->ckm", shape, (signs * shared)[:, :2]) + own
        assert np.all(np.abs(weights @ moved) <= columns)
        apart = np.sign(random.normal(size=noise.shape)) * noise
        moved = np.einsum("ckt,t->ck", shape, (signs * shared)[:, 2]) + apart
        assert np.all(np.abs(np.einsum("cwk,ck->cw", weights, moved)) <= readings)
    worst = np.sign(np.einsum("k,kt->t", weights[0, 0], shape[0])) * shared[:, 2]
    most = weights[0, 0] @ shape[0] @ worst + np.abs(weights[0, 0]) @ noise[0]
    assert readings[0, 0] == pytest.approx(most, rel=1e-10) and readings[0, 0] >= most


# ---- boxes --------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, 1.5, -40.0])
@pytest.mark.parametrize("seed", slow_after(1, [1, 2, 3]))
def test_boxes_are_finite_and_hold_the_truth_and_the_signal(seed: int, start: float) -> None:
    data, z = simulated(start, seed=seed)
    formulation = formulated(data)
    box = cell_box(formulation, start_of(formulation))
    assert box is not None and not box.open
    theta = np.array([TRUTH[name] for name in formulation.parameters])
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert np.all((box.low <= z) & (z <= box.high))
    assert np.all(np.isfinite([box.low, box.high]))


def test_outputs_follow_from_no_first_sample_without_bounds() -> None:
    """The internal signal has a first sample that cells alone bound, and no reading."""
    formulation = formulated(simulated(0.0, samples=20)[0])
    equations = equations_of(formulation.model, ("y1",))
    assert recursion_from(formulation, equations) is None


def test_a_first_sample_is_felt_as_long_as_the_pole_lets_it() -> None:
    """z(k) of the start alone is start times pole^k, in the cell of the true coefficients."""
    formulation = formulated(simulated(-40.0)[0])
    parts = parts_of(formulation)
    true, none = np.array([[-0.5, 0.8, 0.24]]), np.zeros((1, 3))
    fit = Fitted(true, none, np.ones(1, bool), np.zeros(1, bool))
    cells = np.array([[[-0.4, 1.0], [-0.4, 1.0]]])
    reach = cell_signals._from_start(parts, formulation, cells, fit)[0]
    assert np.all(reach >= 40.0 * 0.4 ** np.arange(50)) and reach[0] < 41.0


def test_products_that_underflow_are_not_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """The product of the least double and 0.3 is none, and lies within the bounds."""
    data, z = simulated(0.0, samples=20)
    formulation = formulated(data)
    least = np.nextafter(0.0, 1.0)
    monkeypatch.setattr(cell_signals, "factor_of", lambda *_: np.full((1, 2), least))
    fit = Fitted(
        np.array([[-0.5, 0.8, 0.24]]), np.zeros((1, 3)), np.ones(1, bool), np.zeros(1, bool)
    )
    cells, kept = np.array([[[-0.4, 1.0], [-0.4, 1.0]]]), np.arange(1)
    low, high = cell_signals.signal_bounds(
        parts_of(formulation), formulation, cells, fit, kept, np.inf
    )
    inside = np.flatnonzero((np.abs(z) > 0.1) & (np.abs(z) < 0.4))
    assert inside.size
    for k in inside:
        product = Fraction(least) * Fraction(z[k])
        assert Fraction(low[k]) < product < Fraction(high[k])


@pytest.mark.parametrize(
    ("pole", "delay"),
    slow_unless(lambda pole, _: pole == 0.0, [(0.0, 0), (0.0, 2), (0.7, 2), (0.7, 0)]),
)
def test_two_numerators_and_other_delays(pole: float, delay: int) -> None:
    random, samples = np.random.default_rng(7), 60
    u, z, y = random.uniform(-1.0, 1.0, samples), np.full(samples, 2.0), np.full(samples, 0.5)
    for k in range(max(1, delay), samples):
        z[k] = -pole * z[k - 1] + u[k - delay]
    w = z - 0.6 * z**2
    for k in range(2, samples):
        y[k] = 0.3 * y[k - 1] + w[k - 1] - 0.5 * w[k - 2]
    shapes = setid.TransferFunction(1, 1, delay), setid.TransferFunction(1, 2, 1)
    model = setid.BlockStructured(
        {("z", "u1"): shapes[0], ("y1", "w"): shapes[1]},
        {"w": setid.StaticMap("z", 2)},
        normalise=[f"b[z,u1]{delay}", "gamma1"],
    )
    data = setid.IOData(u, y + 1e-4 * random.uniform(-1.0, 1.0, samples))
    known = setid.formulate(data, model, setid.Noise(output=1e-4), [setid.Stable()])
    box = cell_box(known, start_of(known))
    truth = {"a[z,u1]1": pole, "a[y1,w]1": -0.3, "b[y1,w]1": 1.0, "b[y1,w]2": -0.5, "gamma2": -0.6}
    theta = np.array([truth[name] for name in known.parameters])
    assert box is not None and not box.open
    assert np.all((box.lower <= theta) & (theta <= box.upper))


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.6, -0.9])
def test_ratios_of_the_first_numerator(ratio: float) -> None:
    random, samples = np.random.default_rng(11), 60
    u, z = random.uniform(-1.0, 1.0, samples), np.full(samples, 2.0)
    for k in range(2, samples):
        z[k] = 0.4 * z[k - 1] + u[k - 1] + ratio * u[k - 2]
    shape = setid.TransferFunction(1, 2, 1)
    model = setid.Wiener(shape, 2, normalise="gamma1")
    y = z + 0.3 * z**2 + 1e-3 * random.uniform(-1.0, 1.0, samples)
    known = setid.formulate(setid.IOData(u, y), model, setid.Noise(output=1e-3), [setid.Stable()])
    box = cell_box(known, start_of(known))
    truth = {"a1": -0.4, "b1": 1.0, "b2": ratio, "gamma2": 0.3}
    theta = np.array([truth[name] for name in known.parameters])
    assert box is not None and not box.open
    assert np.all((box.lower <= theta) & (theta <= box.upper))


def test_missing_readings_are_left_out() -> None:
    data, z = simulated(1.0, 60)
    y = data.y.copy()
    y[[0, 25]] = np.nan
    formulation = formulated(setid.IOData(data.u, y))
    box = cell_box(formulation, start_of(formulation))
    theta = np.array([TRUTH[name] for name in formulation.parameters])
    assert box is not None and not box.open
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert np.all((box.low <= z) & (z <= box.high))


def test_a_square_that_may_vanish_bounds_the_signal_all_the_same() -> None:
    """z and -z - 1 / gamma2 have the same z + gamma2 z^2, but not the same samples after them."""
    random, samples = np.random.default_rng(1), 50
    u, z, y = random.uniform(-1.0, 1.0, samples), np.zeros(samples), np.zeros(samples)
    for k in range(1, samples):
        z[k] = 0.4 * z[k - 1] + u[k - 1]
        y[k] = 0.5 * y[k - 1] + 0.8 * z[k - 1]
    formulation = formulated(setid.IOData(u, y))
    box = cell_box(formulation, start_of(formulation))
    assert box is not None and not box.open
    assert box.lower[3] <= 0.0 <= box.upper[3]
    assert np.all((box.low <= z) & (z <= box.high)) and np.max(box.high - box.low) < 1.0
    assert recursion_of(formulation, box) is not None


# ---- a first sample as a coordinate -------------------------------------------------------

ONE, TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(1, 2, 1)
POLES = setid.Box({"a1": (-0.8, -0.3)})
SLOW = pytest.mark.slow
STARTED = {  # structure, priors, poles and what follows, first samples of z
    "weak square": (setid.Wiener(ONE, 2, "gamma1"), setid.Stable(), [-0.6, 0.5, 0.3], 0.4),
    "cubic": (setid.Wiener(ONE, 3, "gamma1"), POLES, [-0.6, 0.5, 0.3, 0.1], -1.5),
    "two numerators": (setid.Wiener(TWO, 2, "gamma1"), setid.Stable(), [-0.6, 0.5, 0.3, 0.3], 2.0),
    "far": (setid.Wiener(ONE, 2, "gamma1"), setid.Stable(), [-0.6, 0.5, 0.3], 12.0),
}


def begun_anywhere(name: str, seed: int) -> tuple[setid.Formulation, np.ndarray, np.ndarray]:
    model, priors, theta, start = STARTED[name]
    random, samples = np.random.default_rng(seed), 60
    u, z = random.uniform(-1.0, 1.0, samples), np.full(samples, start)
    a, b = theta[0], theta[1 : 3 if name == "two numerators" else 2]
    for k in range(len(b), samples):
        z[k] = -a * z[k - 1] + sum(c * u[k - 1 - j] for j, c in enumerate(b))
    powers = [1.0, *theta[1 + len(b) :]]
    y = sum(g * z**p for p, g in enumerate(powers, 1)) + 0.01 * random.uniform(-1, 1, samples)
    data = setid.IOData(u, y)
    return setid.formulate(data, model, setid.Noise(output=0.01), priors), np.array(theta), z


@pytest.mark.parametrize("seed", slow_after(1, [1, 2]))
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=SLOW) if n == "two numerators" else n for n in STARTED]
)
def test_boxes_hold_the_truth_whatever_the_first_samples_are(name: str, seed: int) -> None:
    formulation, theta, z = begun_anywhere(name, seed)
    box = cell_box(formulation, start_of(formulation))
    assert box is not None and not box.open
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert np.all((box.low <= z[: box.low.size]) & (z[: box.low.size] <= box.high))
    assert np.all(np.isfinite([box.low, box.high]))
    assert box.verify(formulation, start_of(formulation))
    assert np.max(box.high[10:] - box.low[10:]) < 0.2 * np.ptp(z[10:])


def test_a_map_whose_square_says_little_closes_from_anywhere() -> None:
    """Combinations of rows alone leave gamma2 between -.6 and 3.3, and z without bounds."""
    formulation, theta, _ = begun_anywhere("weak square", 1)
    options = setid.Options(tol=0.1, time_limit=60.0, progress=False)
    found = setid.identify(
        formulation.data, formulation.model, formulation.noise, setid.Stable(), options
    )
    assert found.status == setid.IntervalStatus.CERTIFIED
    assert all(value in found.intervals[n] for n, value in zip(found.intervals, theta, strict=True))


@pytest.mark.parametrize(
    ("poles", "possible"), [((-0.8, -0.3), True), ((-0.8, 0.0), False), ((-1.0, -0.3), False)]
)
def test_first_samples_are_no_coordinates_where_poles_may_be_at_zero_or_one(
    poles: tuple[float, float], possible: bool
) -> None:
    """One row alone holds the first sample where a = 0; where a = -1 it is an offset of the map."""
    data, model = begun_anywhere("cubic", 1)[0].data, STARTED["cubic"][0]
    known = setid.formulate(data, model, setid.Noise(output=0.01), setid.Box({"a1": poles}))
    assert (cell_box(known, start_of(known)) is not None) == possible


def test_cubic_maps_and_blocks_of_order_two_ask_for_rest() -> None:
    data, _ = simulated(0.0)
    for degree, possible in ((1, True), (2, True), (3, False)):
        parts = parts_of(formulated(data, degree=degree))
        assert parts is not None and can_start(parts) == possible
    formulation = formulated(data, degree=3)
    assert cell_box(formulation, start_of(formulation)) is None
    found = setid.identify(
        data, cascade(degree=3), setid.Noise(output=NOISE), setid.Stable(), QUICK
    )
    assert "initial='zero' where the record begins at rest" in found.notes[-1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_blocks_without_poles_forget_their_first_samples(seed: int) -> None:
    """z_0 and z_1 rest on inputs before the record, and no impulse stands for them."""
    random, samples = np.random.default_rng(seed), 40
    u, z = random.uniform(-1.0, 1.0, samples), random.uniform(-3.0, 3.0, samples)
    z[2:] = 0.8 * u[1:-1] - 0.5 * u[:-2]
    y = z + 0.3 * z**2 + 0.01 * random.uniform(-1.0, 1.0, samples)
    model = setid.Wiener(setid.TransferFunction(0, 2, 1), 2, "gamma1")
    formulation = setid.formulate(setid.IOData(u, y), model, setid.Noise(output=0.01))
    box = cell_box(formulation, start_of(formulation))
    assert box is not None and not box.open
    theta = np.array([0.8, -0.5, 0.3])
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert np.all((box.low <= z) & (z <= box.high))


@pytest.mark.parametrize("initial", ["free", "zero"])
def test_blocks_without_parameters_need_no_cells(initial: str) -> None:
    """A delay before the map: its signal is no unknown, and rows in the parameters say all."""
    delay, behind = setid.TransferFunction(0, 1, 1), setid.TransferFunction(1, 1, 1)
    blocks, maps = {("z", "u1"): delay, ("y1", "w"): behind}, {"w": setid.StaticMap("z", 2)}
    names = ["b[z,u1]1", "gamma1"]
    model = setid.BlockStructured(blocks, maps, normalise=names, initial=initial)
    u, noise = np.random.default_rng(0).uniform(-1, 1, (40, 1)), setid.Noise(output=0.01)
    theta = {"a[y1,w]1": -0.5, "b[y1,w]1": 0.8, "gamma2": 0.3}
    data = setid.simulate_record(model, [theta[n] for n in model.parameters], u, noise).data
    formulation = setid.formulate(data, model, noise, setid.Stable())
    assert cell_box(formulation, start_of(formulation)) is None
    found = setid.identify(data, model, noise, setid.Stable(), QUICK)
    assert all(value in found.intervals[name] for name, value in theta.items())
    assert all(np.isfinite(item.outer).all() for item in found.intervals.values())


def test_samples_before_the_drives_are_in_no_row() -> None:
    formulation, _, _ = begun_anywhere("two numerators", 1)
    parts = parts_of(formulation)
    assert parts is not None and (parts.initial, parts.begin) == (2, None)
    later = with_impulses(parts)
    assert (later.initial, later.begin, len(later.drives)) == (0, 1, 3)
    assert np.array_equal(later.drives[2], np.eye(1, 60, 1)[0])
    assert not later.drives[:2, :2].any()


# ---- identification -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def found() -> setid.Identification:
    data, _ = simulated(0.7, 20)
    return setid.identify(data, cascade(), setid.Noise(output=NOISE), setid.Stable(), QUICK)


def test_a_cascade_closes_whatever_its_past(found: setid.Identification) -> None:
    assert found.verify()
    for name, item in found.intervals.items():
        assert TRUTH[name] in item
        assert item.inner is not None
        assert np.ptp(item.outer) <= 1.06 * np.ptp(item.inner)


def test_bands_of_internal_signals_hold_them(found: setid.Identification) -> None:
    _, z = simulated(0.7, 20)
    for name, values in (("z", z), ("w", z + 0.3 * z**2)):
        band = setid.signal_band(found, name)
        known = ~np.isnan(band.low)  # the last sample of w is read by no output
        assert np.sum(known) >= 19
        low, high = band.low[known], band.high[known]
        assert np.all((low <= values[known]) & (values[known] <= high))
        assert np.max(high[8:] - low[8:]) < 0.5


def test_first_samples_are_unknowns_of_the_regions(found: setid.Identification) -> None:
    box, formulation = found.evidence.box, found.formulation
    parts = recursion_of(formulation, box.first)
    assert parts is not None and list(parts.past) == ["z", "y1"]
    assert parts.dimension == box.directions.shape[1] == 6
    assert parts.readings.tolist() == [5]
    assert recursion_of(formulation) is None
    assert not replace(box, first=None).verify(formulation, start_of(formulation))


def test_cells_that_claim_less_do_not_follow(found: setid.Identification) -> None:
    box, formulation = found.evidence.box, found.formulation
    start = start_of(formulation)
    assert isinstance(box.first, CellBox) and box.first.verify(formulation, start)
    for name, sign in (("lower", 1.0), ("upper", -1.0), ("low", 1.0), ("high", -1.0)):
        ends = getattr(box.first, name) + sign * 1e-6
        forged = replace(box.first, **{name: ends})
        assert not forged.verify(formulation, start)
        assert not replace(box, first=forged).verify(formulation, start)


def test_the_tree_is_written_and_read(found: setid.Identification) -> None:
    again = setid.Identification.from_json(found.to_json())
    for name, item in found.intervals.items():
        assert again.intervals[name].outer == item.outer
    assert again.to_json() == found.to_json()
