"""Cells are examined in portions, and what is left when time or room ends is a cover still."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.proofs.cells import cell_normalisation, output_cells
from setid.proofs.cells.arithmetic import Enclosed, Fitted, enclosed, rows_of
from setid.proofs.cells.cell_normalisation import converted, divided, factor_of
from setid.proofs.cells.output_cells import CellBox, cell_box
from setid.proofs.cells.parts import Column
from setid.proofs.parameter_box import start_of

TRUTH = {1: (-0.7, 0.3, 0.3, 0.1), 2: (-1.1, 0.4, 0.2, 0.1, 0.3, 0.1)}


def formulated(order: int, degree: int, initial: str = "zero", seed: int = 0):
    """A record of a Wiener system from rest with 1 % of noise, the first part left out or not."""
    shape = setid.TransferFunction(order, order, 1)
    model = setid.Wiener(shape, degree, "gamma1", initial=initial)
    theta = TRUTH[order][: len(model.parameters)]
    random = np.random.default_rng(seed)
    late = 0 if initial == "zero" else 20
    u = random.uniform(-1, 1, 50 + late)
    at_rest = setid.Wiener(shape, degree, "gamma1", initial="zero")
    y = setid.simulate(at_rest, theta, u)[:, 0]
    bound = 0.01 * float(np.abs(y).max())
    data = setid.IOData(u[late:], (y + random.uniform(-bound, bound, y.size))[late:])
    return setid.formulate(data, model, setid.Noise(output=bound), setid.Stable()), theta


def boxed(known: setid.Formulation, **options) -> CellBox:
    found = cell_box(known, start_of(known), **options)
    assert found is not None
    return found


def holds(found: CellBox, theta: tuple[float, ...]) -> bool:
    return bool(np.all(found.lower <= theta) and np.all(theta <= found.upper))


@pytest.mark.parametrize("initial", ["zero", "free"])
def test_portions_change_nothing(initial: str, monkeypatch: pytest.MonkeyPatch) -> None:
    known, theta = formulated(1, 2, initial)
    whole = boxed(known)
    monkeypatch.setattr(output_cells, "_AT_ONCE", 7)
    monkeypatch.setattr(output_cells, "_AT_ONCE_FREE", 3)
    found = boxed(known)
    assert holds(found, theta) and not found.open
    assert (found.cells, found.rounds) == (whole.cells, whole.rounds)
    for one, two in ((found.lower, whole.lower), (found.upper, whole.upper)):
        assert one == pytest.approx(two, rel=1e-9)


@pytest.mark.parametrize("calls", [1, 2, 3, 5, 8, 13, 21, 34])
def test_what_is_left_when_time_ends_is_a_cover(
    calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time ends at some look at the clock: between rounds, or in the middle of one."""
    known, theta = formulated(1, 2)
    clock = itertools.chain(itertools.repeat(0.0, calls), itertools.repeat(2.0))
    with monkeypatch.context() as patch:
        patch.setattr(output_cells, "_AT_ONCE", 2)
        patch.setattr(output_cells.time, "monotonic", lambda: next(clock))
        found = boxed(known, until=1.0)
    assert holds(found, theta)
    assert found.verify(known, start_of(known))  # replays end where the search did


@pytest.mark.parametrize("rounds", [3, 6, 9])
def test_more_cells_than_are_bounded_keep_the_poles(
    rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, theta = formulated(1, 2)
    each = boxed(known, rounds=rounds)
    monkeypatch.setattr(output_cells, "_MOST_LEFT", 0)
    found = boxed(known, rounds=rounds)
    assert holds(found, theta) and found.cells == each.cells
    assert np.all(found.low == -np.inf) and np.all(found.high == np.inf)  # nothing of the signal
    assert found.verify(known, start_of(known))
    assert np.all(found.lower <= each.lower) and np.all(each.upper <= found.upper)
    assert found.lower[0] > -1.0 or rounds < 6  # of the pole something is known


@pytest.mark.parametrize("most", [0, 10**9])
def test_cells_are_not_asked_where_one_of_many_says_nothing(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hull is that of all cells anyway, but for what emptiness says of the poles."""
    asked = 0
    one_cell = cell_normalisation._one_cell

    def ask(*given: Any) -> Any:
        nonlocal asked
        asked += 1
        return one_cell(*given)

    monkeypatch.setattr(cell_normalisation, "_MOST_ASKED", most)
    monkeypatch.setattr(cell_normalisation, "_one_cell", ask)
    known, theta = formulated(1, 2)
    coarse = boxed(known, rounds=0)
    assert holds(coarse, theta) and coarse.verify(known, start_of(known))
    assert (asked == 0) == (most == 0) and coarse.open == ("b1", "gamma2")
    asked = 0
    fine = boxed(known)  # now each says something
    assert asked > 0 and holds(fine, theta) and not fine.open


def test_the_signal_in_cells_that_are_not_asked_is_within_its_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, _ = formulated(1, 2)
    each = boxed(known, rounds=4)
    monkeypatch.setattr(cell_normalisation, "_MOST_ASKED", 0)
    monkeypatch.setattr(
        cell_normalisation, "_says_nothing", lambda fit, _: np.ones(len(fit.bounded), bool)
    )
    found = boxed(known, rounds=4)
    assert found.cells == each.cells > 1 and np.all(np.isfinite([each.low, each.high]))
    assert np.all(found.low <= each.low) and np.all(each.high <= found.high)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_cubic_maps_behind_order_two_have_a_box(seed: int) -> None:
    known, theta = formulated(2, 3, seed=seed)
    found = boxed(known)
    assert holds(found, theta) and not found.open


def test_a_box_that_says_no_more_than_the_priors_needs_no_replay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, _ = formulated(1, 2)
    start = start_of(known)
    bare = replace(boxed(known, rounds=0, samples=False), lower=start[0], upper=start[1])
    none = np.full(bare.low.shape, np.inf)
    claims = [
        replace(bare, low=none, high=-none),  # no sample has a value: the set is empty
        replace(bare, low=np.zeros_like(none)),
        replace(bare, upper=np.minimum(start[1], 0.99)),
        replace(bare, lower=np.maximum(start[0], -0.99)),
        replace(bare, lower=start[0][:1], upper=start[1][:1]),
    ]
    monkeypatch.setattr(output_cells, "cell_box", lambda *_, **__: None)  # nothing is computed
    assert replace(bare, low=-none, high=none).verify(known, start)
    assert not any(claim.verify(known, start) for claim in claims)


def test_a_box_of_the_pole_bounds_cubic_maps_with_an_unknown_past() -> None:
    """The note says so: away from 0 and -1 first samples are coordinates of cells."""
    known, theta = formulated(1, 3, "free")
    data, model, noise = known.data, known.model, known.noise
    short = setid.Options(time_limit=1.0, progress=False)
    bare = setid.identify(data, model, noise, setid.Stable(), short)
    assert "Box for a1 that leaves out -1 and 0" in bare.notes[-1]
    away = setid.Box({"a1": (-0.95, -0.3)})
    found = boxed(setid.formulate(data, model, noise, [setid.Stable(), away]))
    assert holds(found, theta) and not found.open


# ---- numbers near the ends of the doubles -------------------------------------------------


def test_powers_that_underflow_are_within_their_widths() -> None:
    z = np.array([[1e-110, -3e-120, 1e-300, 5e-324, 0.7]])
    found = Enclosed(z, 0 * z, np.zeros((1, 1, 5)), np.zeros((1, 1)))
    none = np.zeros((5, 0))
    rows = rows_of(found, np.arange(5), ((0, 2), (0, 3)), (none, none), z[0], z[0])
    for k, value in enumerate(z[0]):
        for m, power in enumerate((2, 3)):
            off = Fraction(float(value)) ** power - Fraction(float(rows.matrix[0, k, m]))
            assert abs(off) <= Fraction(float(rows.wide[0, k, m]))


def test_signals_that_decay_below_all_doubles_are_enclosed() -> None:
    a = 3e-160
    found = enclosed(np.array([[[a, 1.0], [a, 1.0]]]), 1, np.eye(1, 4), np.zeros((1, 4)))
    exact = [(-Fraction(a)) ** k for k in range(4)]
    for k, value in enumerate(exact):
        off = abs(value - Fraction(float(found.centre[0, k])))
        assert off <= Fraction(float(found.radius[0, k]))


@pytest.mark.parametrize("size", [1e-110, 1e105, 1e110, 1e160])
def test_cubic_maps_are_bounded_whatever_the_unit_of_the_input(size: float) -> None:
    """With b1 = 1 the coefficients are 0.3, 0.3 0.3^2 and 0.1 0.3^3 by powers of the unit."""
    known, _ = formulated(1, 3)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 3, "b1", initial="zero")
    data = setid.IOData(known.data.u * size, known.data.y)
    found = boxed(setid.formulate(data, model, known.noise, known.priors))
    exact = [Fraction("-0.7"), *(Fraction(c) for c in ("0.3", "0.027", "0.0027"))]
    for power, (low, high) in enumerate(zip(found.lower, found.upper, strict=True)):
        value = exact[power] / Fraction(size) ** power
        assert low == -np.inf or Fraction(float(low)) <= value
        assert high == np.inf or value <= Fraction(float(high))
    assert found.upper[0] - found.lower[0] < 0.1


def test_quotients_beyond_the_doubles_are_rounded_outwards() -> None:
    tops = [[1e-300, 2e-300], [-2e-300, -1e-300], [1e300, 2e300], [-2e300, -1e300], [-1.0, 1e300]]
    belows = [[1e30, 2e30], [1e30, 2e30], [1e-30, 2e-30], [1e-30, 2e-30], [1e-30, 1.0]]
    ends = divided(np.array(tops), np.array(belows))
    for top, below, (low, high) in zip(tops, belows, ends, strict=True):
        corners = [Fraction(t) / Fraction(b) for t in top for b in below]
        assert low == -np.inf or Fraction(low) <= min(corners)
        assert high == np.inf or max(corners) <= Fraction(high)
        assert low < np.inf and high > -np.inf


@pytest.mark.parametrize("fixed", [1.0, 1e100, 1e-300])
@pytest.mark.parametrize("constant", [1.0, 1e290, 1e-300])
@pytest.mark.parametrize("gamma", [1e-280, 3.0, 1e200])
@pytest.mark.parametrize("size", [1e-158, 1e-150, 1e120])
def test_coefficients_are_bounded_whatever_the_units(
    size: float, gamma: float, constant: float, fixed: float
) -> None:
    """With w = b1 v, rows gamma z^2 and a face where b1 is 1: products may leave the doubles."""
    names = ("a1", "v", "w", "g2")
    cell = np.array([0.5, size, 1.0])
    parts = SimpleNamespace(
        poles=("a1",), words=(("f",), ("w", "h")), constants=np.full(2, constant), past=(),
        numerator=(), columns=(Column(0, 2, ("g2", "h")),), label="G",
    )  # fmt: skip
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, "b1", initial="zero")
    object.__setattr__(model, "fixed", (("f", constant), ("h", fixed)))
    fit = Fitted(np.full((1, 1), gamma), np.zeros((1, 1)), np.ones(1, bool), np.zeros(1, bool))
    given = SimpleNamespace(parameters=names, model=model)
    start = np.array([[-np.inf] * 4, [np.inf] * 4])
    hull, kept = converted(parts, given, start, np.array([[cell, cell]]), fit)
    assert kept.tolist() == [0]
    scale = 1 / Fraction(size)  # of the face, with which f = constant * size * scale
    exact = {
        "w": scale * Fraction(constant) / Fraction(fixed),
        "g2": Fraction(gamma) / scale**2 / Fraction(fixed),
    }
    for name, value in exact.items():
        low, high = hull[:, names.index(name)]
        assert low == -np.inf or Fraction(float(low)) <= value
        assert high == np.inf or value <= Fraction(float(high))
        assert low < np.inf and high > -np.inf


def test_static_gains_near_a_pole_at_one_carry_the_rounding_of_sums() -> None:
    """1 + a1 + a2 + a3 may be off by 1e-16, which is much of what is left of it."""
    random = np.random.default_rng(3)
    for _ in range(200):
        a = random.uniform(-2, 1, 3)
        a[2] = np.nextafter(-1.0 - a[0] - a[1], 9.0) + 3e-16
        cell = np.append(a, 1.0)
        parts = SimpleNamespace(
            poles=("a1", "a2", "a3"), words=(("b1",),), constants=np.ones(1), columns=(), past=(),
            label="G",
        )  # fmt: skip
        blocks = {"G": SimpleNamespace(numerator=("b1",))}
        model = SimpleNamespace(fixed=(), unit_gain=("G",), linear_blocks=blocks)
        low, high = factor_of(parts, model, np.array([[cell, cell]]), None)[0]
        exact = 1 + sum(map(Fraction, a.tolist()))
        assert Fraction(low) <= exact <= Fraction(high)


@pytest.mark.parametrize("fixed", [-2.0, 0.5])
@pytest.mark.parametrize("complete", [True, False])
def test_static_gains_behind_a_map_are_those_of_coefficients_alone(
    fixed: float, complete: bool
) -> None:
    """The face has b1 g1 = 1, b2 g1 = 1/2, b1 g2 = 1/8: b1 + b2 = 1 + a1 = 3/4 by hand."""
    words = (("b1", "g1"), ("b2", "g1"), ("b1", "g2"))
    if not complete:  # without one of them their sum is not known
        words = (("b1", "g1"), ("b2", "g2"), ("b1", "g2"))
    parts = SimpleNamespace(
        poles=("a1",), words=words, constants=np.array([2.0, 1.0, 4.0]), columns=(), past=(),
        label="G",
    )  # fmt: skip
    blocks = {"G": SimpleNamespace(numerator=("b1", "b2"))}
    model = SimpleNamespace(fixed=(("g1", fixed),), unit_gain=("G",), linear_blocks=blocks)
    cell = np.array([-0.25, 0.5, 0.5, 0.03125])
    low, high = factor_of(parts, model, np.array([[cell, cell]]), None)[0]
    exact = 0.75 / ((1.0 + 0.5) / fixed)  # both are doubles
    assert low <= exact <= high
    assert (high - low < 1e-10) == complete


@pytest.mark.parametrize("fixed", [-2.0, 0.3, -1e-3])
@pytest.mark.parametrize("width", [0.0, 1e-16, 0.1])
def test_static_gains_of_cells_hold_those_of_their_points(fixed: float, width: float) -> None:
    """Coefficients may cancel but for rounding, and the sum of them may change sign."""
    random = np.random.default_rng(4)
    parts = SimpleNamespace(
        poles=("a1",), words=(("b1", "g1"), ("b2", "g1")), constants=np.array([0.7, 0.9]),
        columns=(), past=(), label="G",
    )  # fmt: skip
    blocks = {"G": SimpleNamespace(numerator=("b1", "b2"))}
    model = SimpleNamespace(fixed=(("g1", fixed),), unit_gain=("G",), linear_blocks=blocks)
    for _ in range(60):
        b = float(random.uniform(0.1, 1.0))
        middle = np.array([random.uniform(-0.9, 0.9), b, -0.7 * b / 0.9])
        low, high = middle - width, middle + width
        first, last = factor_of(parts, model, np.array([[low, high]]), None)[0].tolist()
        for point in itertools.product(*zip(low.tolist(), high.tolist(), strict=True)):
            a1, b1, b2 = map(Fraction, point)
            gain = (Fraction(0.7) * b1 + Fraction(0.9) * b2) / Fraction(fixed)
            if gain:
                exact = (1 + a1) / gain
                assert first == -np.inf or Fraction(first) <= exact
                assert last == np.inf or exact <= Fraction(last)


def test_a_static_gain_bounds_a_map_before_the_block() -> None:
    """z = G w, w = u + .2 u^2, y = z + .4 z^2 with z(k) = .5 z(k-1) + .5 w(k-1)."""
    model = setid.HammersteinWiener(
        setid.TransferFunction(1, 1, 1), 2, 2, ["gamma[w]1", "dcgain"], initial="zero"
    )
    u, z = np.random.default_rng(0).uniform(-1, 1, 30), np.zeros(30)
    w = u + 0.2 * u**2
    for k in range(1, 30):
        z[k] = 0.5 * z[k - 1] + 0.5 * w[k - 1]
    data = setid.IOData(u, z + 0.4 * z**2)
    found = boxed(setid.formulate(data, model, setid.Noise(output=0.005), setid.Stable()))
    assert holds(found, (-0.5, 0.5, 0.2, 1.0, 0.4))
    assert np.all(found.upper - found.lower < 1.0)


def test_a_coefficient_of_a_sum_of_signals_counts_once() -> None:
    """With z(k) = .5 z(k-1) + .5 (u1 - u2)(k-1), the coefficient b1 has a row for each input."""
    model = setid.BlockStructured(
        {("z", "u1 - u2"): setid.TransferFunction(1, 1, 1)},
        {"y1": setid.StaticMap("z", 2)},
        inputs=2,
        normalise="dcgain",
        initial="zero",
    )
    u, z = np.random.default_rng(3).uniform(-1, 1, (40, 2)), np.zeros(40)
    for k in range(1, 40):
        z[k] = 0.5 * z[k - 1] + 0.5 * (u[k - 1, 0] - u[k - 1, 1])
    data = setid.IOData(u, z + 0.3 * z**2)
    found = boxed(setid.formulate(data, model, setid.Noise(output=0.01), setid.Stable()))
    assert holds(found, (-0.5, 0.5, 1.0, 0.3))
    assert np.all(found.upper - found.lower < 1.0)


@pytest.mark.parametrize(("na", "nb"), [(1, 1), (0, 2)])
def test_rows_that_hold_samples_before_the_record_are_left_out(na: int, nb: int) -> None:
    """z = b u has no state, but y = H (z + .5 z^2) has one, which is not zero."""
    model = setid.BlockStructured(
        {("z", "u1"): setid.TransferFunction(0, 1, 0), ("y1", "w"): setid.TransferFunction(na, nb)},
        {"w": setid.StaticMap("z", 2)},
        normalise=["gamma1", "dcgain[z,u1]"],
    )
    u = np.random.default_rng(5).uniform(-1, 1, 40)
    w, y = u + 0.5 * u**2, np.zeros(40)
    for k in range(1, 40):
        y[k] = 0.7 * w[k] + (0.6 * y[k - 1] if na else 0.4 * w[k - 1])
    data = setid.IOData(u[10:], y[10:])
    found = boxed(setid.formulate(data, model, setid.Noise(output=0.001)))
    given = {"a[y1,w]1": -0.6, "b[z,u1]0": 1.0, "b[y1,w]0": 0.7, "b[y1,w]1": 0.4, "gamma2": 0.5}
    assert holds(found, [given[name] for name in found.names])
    assert not found.open


def test_cells_remain_where_only_rounding_breaks_a_prior() -> None:
    """Two products of 1e12 that are rounded down leave 1e-4 less than there is."""
    random, kept = np.random.default_rng(4), 0
    while kept < 5:
        a = np.array([random.uniform(0.6, 0.9), 0.0])
        a[1] = -a[0] * random.uniform(0.98, 0.99)
        exact = sum(Fraction(float(v)) * 10**12 for v in a)
        level = float(exact) if Fraction(float(exact)) <= exact else np.nextafter(float(exact), 0.0)
        if (-level + a[0] * 1e12) + a[1] * 1e12 >= -1e-8:
            continue
        kept += 1
        a1, a2 = sp.variables(2)
        row = SimpleNamespace(polynomial=1e12 * a1 + 1e12 * a2 - float(level))
        given = SimpleNamespace(
            parameters=("a1", "a2"), problem=SimpleNamespace(constraints=[row]),
            rows=SimpleNamespace(origin=["prior"]),
        )  # fmt: skip
        cells = np.array([[a, a]])
        assert output_cells._allowed(SimpleNamespace(poles=("a1", "a2")), given, cells).all()
