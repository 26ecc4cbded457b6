"""Block structures: what they state, what is proved of them, and what is refused."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from prior_cases import Never
from slow_values import slow_after

import setid
import sparsepop_py as sp
from setid.export.matlab_files import ureal_script
from setid.models.block import StaticMap
from setid.simulation.responses import transfer_of

G = setid.TransferFunction
ONE, TWO = G(1, 1, 1), G(2, 2, 1)
QUICK = setid.Options(time_limit=60.0, progress=False, tol=5e-2)
CASES = {
    "hammerstein": (setid.Hammerstein(ONE, 3, "gamma1"), [-0.7, 0.8, 0.4, -0.3], ()),
    "static gain": (setid.Hammerstein(ONE, 2, "dcgain"), [-0.7, 0.3, 1.0, 0.4], ()),
    "wiener": (
        setid.Wiener(ONE, 2, "gamma1", initial="zero"),
        [-0.7, 0.3, 0.3],
        (setid.Stable(),),
    ),
    "lure": (setid.Lure(ONE, 2, "nolinear"), [-0.6, 0.8, 0.3], ()),
    "both": (
        setid.HammersteinWiener(ONE, 2, 2, ["gamma[w]1", "b1"], initial="zero"),
        [-0.7, 0.3, 1.0, 0.3],
        (setid.Stable(),),
    ),
    "two inputs": (
        setid.BlockStructured(
            {("y1", "w"): ONE, ("y1", "u2"): ONE},
            {"w": StaticMap("u1", 2)},
            inputs=2,
            normalise="gamma1",
        ),
        [-0.5, 0.3, 0.8, 0.6, 0.4],
        (setid.Stable(),),
    ),
}


def simulated(name: str, noise: float, samples: int = 30, seed: int = 0) -> setid.Simulated:
    """A record with noise of a share of the largest output; inputs up to 1."""
    model, theta, _ = CASES[name]
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, model.inputs))
    size = noise * np.abs(setid.simulate(model, theta, u)).max()
    return setid.simulate_record(model, theta, u, setid.Noise(output=size), seed=seed + 1)


def noise_of(truth: setid.Simulated) -> setid.Noise:
    return setid.Noise(output=np.abs(truth.output).max() * 1.05)


@pytest.mark.parametrize("name", CASES)
def test_the_truth_satisfies_all_rows(name: str) -> None:
    """With its own noise and internal signals, the true system is feasible."""
    model, theta, priors = CASES[name]
    truth = simulated(name, 0.02)
    formulation = setid.formulate(truth.data, model, noise_of(truth), priors)
    x = formulation.point(theta, output=truth.output)
    assert formulation.problem.violation(x) < 1e-9
    assert formulation.problem.degree <= 3
    assert setid.least_noise(formulation, theta).level <= 1.0


@pytest.mark.parametrize("name", CASES)
def test_boxes_from_the_data_hold_the_truth_and_shrink_with_the_noise(name: str) -> None:
    model, theta, priors = CASES[name]
    widths = []
    levels = (2e-2, 1e-4, 1e-8) if name != "two inputs" else (2e-2, 1e-4)
    for noise in levels:
        truth = simulated(name, noise)
        formulation = setid.formulate(truth.data, model, noise_of(truth), priors)
        box = box_of(formulation)
        assert np.all(np.isfinite([box.lower, box.upper])), box
        assert np.all((box.lower <= theta) & (theta <= box.upper)), box
        widths.append(np.max(box.upper - box.lower))
    assert widths[1] < widths[0] / 10
    assert widths[-1] < 1e-2


def box_of(formulation: setid.Formulation):
    from setid.proofs.cells.output_cells import cell_box
    from sparsepop_py.uncertain_rows.lifted_products import lifted_box

    p = len(formulation.parameters)
    start = np.array([formulation.problem.lower[:p], formulation.problem.upper[:p]])
    if formulation.products is not None:
        return lifted_box(formulation.products, start)
    return cell_box(formulation, start)


@pytest.mark.parametrize("name", slow_after(2, ["hammerstein", "static gain", "two inputs"]))
def test_sums_of_products_are_certified(name: str) -> None:
    model, theta, priors = CASES[name]
    truth = simulated(name, 0.02)
    result = setid.identify(truth.data, model, noise_of(truth), priors, QUICK)
    for value, item in zip(theta, result.intervals.values(), strict=True):
        assert value in item
        assert item.status == "certified"
    assert result.verify(truth.data).ok
    assert result.feasible.shape == (len(theta),)


@pytest.mark.parametrize("name", ["wiener", "lure"])
def test_coupled_samples_have_proved_ends_and_attained_ones(name: str) -> None:
    model, theta, priors = CASES[name]
    truth = simulated(name, 0.02, samples=16)
    limit = setid.Options(time_limit=5.0, progress=False, tol=0.05)
    result = setid.identify(truth.data, model, noise_of(truth), priors, limit)
    for value, item in zip(theta, result.intervals.values(), strict=True):
        assert value in item
        assert item.inner is not None
        assert item.outer[0] <= item.inner[0] <= item.inner[1] <= item.outer[1]
        assert item.status == "certified"
    assert result.verify(truth.data).ok


@pytest.mark.parametrize("name", CASES)
@pytest.mark.slow
def test_intervals_collapse_on_the_truth(name: str) -> None:
    model, theta, priors = CASES[name]
    truth = simulated(name, 1e-8, samples=14)
    quick = setid.Options(time_limit=8.0, progress=False, tol=0.1)
    result = setid.identify(truth.data, model, noise_of(truth), priors, quick)
    for value, item in zip(theta, result.intervals.values(), strict=True):
        assert value in item
        assert item.width < 1e-6


def test_given_functions_of_an_exact_input() -> None:
    """A saturation known up to its gain: the record is linear in b1 and b1*gamma2."""
    model = setid.Hammerstein(ONE, [1, np.tanh], "gamma1")
    u = np.random.default_rng(4).uniform(-3, 3, 30)
    truth = setid.simulate_record(model, [-0.5, 1.0, 0.6], u, setid.Noise(output=0.01), seed=2)
    w = u + 0.6 * np.tanh(u)
    linear = setid.simulate(ONE, [-0.5, 1.0], w)
    assert np.allclose(truth.y, linear, atol=1e-12)
    result = setid.identify(truth.data, model, setid.Noise(output=0.01), options=QUICK)
    assert 0.6 in result.intervals["gamma2"]
    assert result.intervals["gamma2"].width < 0.1
    with pytest.raises(setid.ModelError, match=r"tanh\(u1\).*not known exactly.*polynomial"):
        setid.formulate(truth.data, model, setid.Noise(output=0.01, input=0.1))


def test_input_noise_makes_internal_signals_of_powers() -> None:
    model, theta, _ = CASES["hammerstein"]
    u = np.random.default_rng(0).uniform(-1, 1, 20)
    noise = setid.Noise(output=0.02, input=0.005)
    truth = setid.simulate_record(model, theta, u, noise, seed=1)
    formulation = setid.formulate(truth.data, model, noise)
    assert {"w", "p[u1^2]", "p[u1^3]"} <= set(formulation.layout.groups)
    assert formulation.problem.degree == 2
    x = formulation.point(theta, output=truth.output, input=truth.input)
    assert formulation.problem.violation(x) < 1e-9


def test_one_product_of_parameters_takes_the_place_of_a_map() -> None:
    """Lur'e of order 1: rows hold b1 gamma2 y^2; with form="partial" the map w itself."""
    model, theta, _ = CASES["lure"]
    truth = simulated("lure", 0.02)
    for form, degree in (("auto", 3), ("partial", 2)):
        other = model.changed(form=form)
        formulation = setid.formulate(truth.data, other, noise_of(truth))
        assert ("w" in formulation.layout.groups) == (form == "partial")
        assert formulation.problem.degree == degree
        x = formulation.point(theta, output=truth.output)
        assert formulation.problem.violation(x) < 1e-9


def test_named_structures_are_instances_of_the_general_one() -> None:
    general = setid.BlockStructured(
        {("y1", "w"): ONE}, {"w": StaticMap("u1", 3)}, normalise="gamma1"
    )
    named, _, _ = CASES["hammerstein"]
    data = simulated("hammerstein", 0.02).data
    one = setid.formulate(data, general, setid.Noise(output=0.1)).problem
    two = setid.formulate(data, named, setid.Noise(output=0.1)).problem
    assert one.fingerprint == two.fingerprint


def test_linear_and_polynomial_models_are_instances() -> None:
    """Without maps: a transfer function; with delays as blocks: a NARX model."""
    data = simulated("hammerstein", 0.02).data
    noise = setid.Noise(equation=0.1)
    bare = setid.BlockStructured({("y1", "u1"): TWO}, {})
    assert (
        setid.formulate(data, bare, noise).problem.fingerprint
        == setid.formulate(data, TWO, noise).problem.fingerprint
    )
    narx = setid.PolynomialNARX(["y1", "u1", "y1*u1"], 1, 1)
    delays = setid.BlockStructured(
        {("x", "y1"): G(0, 1, 1), ("v", "u1"): G(0, 1, 1)},
        {"y1": StaticMap(["x", "v"], [(1, 0), (0, 1), (1, 1)])},
        normalise=["b[x,y1]1", "b[v,u1]1"],
    )
    one, two = (setid.identify(data, m, noise).intervals.values() for m in (narx, delays))
    for left, right in zip(one, two, strict=True):
        assert left.outer == pytest.approx(right.outer, abs=1e-12)


@pytest.mark.parametrize(
    ("model", "affected"),
    [
        (setid.Hammerstein(TWO, 2), ("b1", "b2", "gamma1", "gamma2")),
        (setid.Wiener(ONE, 2), ("b1", "gamma1", "gamma2")),
        (setid.Lure(ONE, 2), ("a1", "gamma1")),
        (setid.Lure(G(1, 2, 1), 2), ()),
        (setid.Lure(ONE, 2, "dcgain"), ()),
        (setid.Wiener(ONE, 2, "dcgain"), ()),
    ],
)
def test_what_is_not_unique_is_found(
    model: setid.BlockStructured, affected: tuple[str, ...]
) -> None:
    assert setid.unidentifiable(model) == affected


def forgeries(result: setid.Identification) -> Iterator[setid.Identification]:
    """Claims that do not follow from the reference, or from one of other data."""
    item, reference = result.intervals["b1"], result.reference
    assert reference is not None
    narrow = replace(item, outer=(0.0, 1.0))
    yield replace(result, intervals={**result.intervals, "b1": narrow})
    empty = setid.IntervalStatus.EMPTY
    nothing = {name: replace(one, status=empty) for name, one in result.intervals.items()}
    yield replace(result, intervals=nothing)
    known = reference.formulation
    other = setid.formulate(known.data, known.model, setid.Noise(output=1.0))
    yield replace(result, reference=replace(reference, formulation=other))
    given = result.formulation
    less = setid.formulate(given.data, given.model, given.noise, [Never()])
    assert less.problem.fingerprint == given.problem.fingerprint
    yield replace(result, formulation=less)  # the reference knows nothing of the prior


def test_a_gain_that_settles_all_parameters_leaves_none_open() -> None:
    model = setid.Hammerstein(setid.TransferFunction(0, 1), [1], ["gamma1", "dcgain"])
    assert model.parameters == ("b0",) and setid.unidentifiable(model) == ()
    data, options = setid.IOData([1.0, -1.0], [1.0, -1.0]), setid.Options(unidentifiable="report")
    found = setid.identify(data, model, setid.Noise(output=0.1), options=options)
    assert found.intervals["b0"].outer == pytest.approx((1.0, 1.0))


@pytest.mark.slow
def test_structures_without_normalisation_are_refused_or_reported() -> None:
    bare = setid.Hammerstein(ONE, 3)
    truth = simulated("hammerstein", 0.02)
    noise = noise_of(truth)
    with pytest.raises(setid.ModelError, match="b1, gamma1, gamma2, gamma3 may change.*dcgain"):
        setid.identify(truth.data, bare, noise)
    go_on = setid.Options(unidentifiable="report", time_limit=20.0, progress=False, tol=5e-2)
    result = setid.identify(truth.data, bare, noise, options=go_on)
    statuses = {name: str(item.status) for name, item in result.intervals.items()}
    assert statuses.pop("a1") == "certified"
    assert set(statuses.values()) == {"unidentifiable"}
    assert -0.7 in result.intervals["a1"]
    assert result.verify(truth.data).ok and result.verify().ok
    for forged in forgeries(result):
        assert not forged.verify(truth.data).ok and not forged.verify().ok
    named = setid.identify(truth.data, CASES["hammerstein"][0], noise, options=QUICK)
    assert result.intervals["a1"].outer == pytest.approx(named.intervals["a1"].outer, abs=2e-3)


@pytest.mark.parametrize("initial", ["free", "zero"])
def test_internal_signals_without_bounds_are_named(initial: str) -> None:
    """z and -z - gamma1 / gamma2 have the same gamma1 z + gamma2 z^2, and few rows follow z(0)."""
    rng = np.random.default_rng(9)
    shape = setid.TransferFunction(1, 1, 1)
    model = setid.Wiener(shape, 2, normalise="b1", initial=initial)
    noise = setid.Noise(output=0.02)
    u = rng.uniform(-1.0, 1.0, 4)
    made = setid.simulate_record(model, [-0.5, 1.0, 0.3], u, noise, rng)
    box = setid.Box({"a1": (-0.9, 0.0), "gamma1": (0.5, 1.5), "gamma2": (0.0, 1.0)})
    options = setid.Options(time_limit=1.0, progress=False)
    found = setid.identify(made.data, model, noise, box, options=options)
    assert found.verify()
    named = [note for note in found.notes if "nothing bounds the internal signals z" in note]
    assert bool(named) == (initial == "free") == any("initial='zero'" in n for n in found.notes)


def test_missing_boxes_are_named() -> None:
    model = setid.Wiener(ONE, 2, "gamma1", initial="zero")
    result = setid.identify(simulated("wiener", 0.02).data, model, setid.Noise(output=0.01))
    assert "a1, b1, gamma2" in result.notes[-1]
    assert "Stable" in result.notes[-1]


class TestEquivalence:
    """The freedoms of the structures, by simulation: independent of how conversion is done."""

    pairs = [
        (setid.Hammerstein(TWO, 3), [-1.1, 0.4, 0.2, 0.1, 1.0, 0.4, 0.2], "dcgain", "gamma3"),
        (setid.Wiener(ONE, 3), [-0.7, 0.3, 1.0, 0.3, 0.2], "dcgain", "b1"),
        (setid.Lure(TWO, 3), [-1.1, 0.4, 0.2, 0.1, 0.3, 0.3, 0.2], "nolinear", "dcgain"),
    ]

    @pytest.mark.parametrize(("model", "theta", "first", "second"), pairs)
    def test_outputs_agree(self, model, theta, first, second) -> None:
        u = np.random.default_rng(2).uniform(-0.5, 0.5, 40)
        first = {"gamma1": 0.0} if first == "nolinear" else first
        expected = setid.simulate(model, theta, u)
        once = setid.convert(model, theta, first)
        assert np.allclose(setid.simulate(model.normalised(first), once, u), expected, atol=1e-10)
        twice = setid.convert(model.normalised(first), once, second)
        other = model.normalised(second)
        assert np.allclose(setid.simulate(other, twice, u), expected, atol=1e-10)
        full = [twice.get(name, dict(other.fixed).get(name)) for name in model.parameters]
        assert setid.equivalent(model, theta, full)
        full[0] += 1e-3
        assert not setid.equivalent(model, theta, full)

    def test_intervals_move_with_the_vectors_in_them(self) -> None:
        model, theta, _ = CASES["hammerstein"]
        truth = simulated("hammerstein", 0.02)
        result = setid.identify(truth.data, model, noise_of(truth), (), QUICK)
        moved = setid.convert_intervals(result, "dcgain")
        goal = setid.convert(model, theta, "dcgain")
        assert all(low <= goal[name] <= high for name, (low, high) in moved.items())
        for item in result.intervals.values():
            for witness in item.witnesses:
                point = setid.convert(model, witness[: len(theta)], "dcgain")
                assert all(low <= point[n] <= high for n, (low, high) in moved.items())

    def test_zero_quantities_cannot_be_fixed(self) -> None:
        with pytest.raises(setid.ModelError, match="may be zero"):
            setid.convert(setid.Hammerstein(ONE, 2), [-0.5, 1.0, 0.0, 1.0], "gamma1")
        with pytest.raises(setid.ModelError, match="settles the scale of w"):
            setid.convert(setid.Hammerstein(ONE, 2), [-0.5, 1.0, 0.5, 1.0], None)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setid.Lure(G(1, 1, 0), 2), "nk = 0"),
        (lambda: setid.Hammerstein(ONE, 0), "basis"),
        (lambda: setid.Hammerstein(ONE, [1, 1]), "repetition"),
        (lambda: setid.Hammerstein(ONE, 2, "gamma7"), "normalise: found 'gamma7'"),
        (lambda: setid.Hammerstein(ONE, [0, 1], "b1", initial="zero"), "not 0 at rest"),
        (lambda: setid.Wiener(ONE, [np.tanh]), "is no power of z"),
        (lambda: setid.BlockStructured({("y1", "w"): ONE}, {}), "'w', which no entry defines"),
        (lambda: setid.BlockStructured({("y1", "u1"): G(1, 1, inputs=2)}, {}), "one input"),
        (lambda: setid.BlockStructured({("y1", "u1 w"): ONE}, {}), "a sum such as"),
    ],
)
def test_wrong_structures_are_named(make, message: str) -> None:
    with pytest.raises(setid.ModelError, match=message):
        make()


def test_points_that_are_known_close_gaps_without_a_search() -> None:
    """x^2 + y^2 <= 1: the point (1, 0) attains the largest x, and is proved again."""
    x, y = sp.variables(2)
    disc = sp.Problem(x, [x**2 + y**2 <= 1], lower=-2, upper=2)
    none = np.zeros(0, np.int64)
    point = sp.ProvedPoint(np.array([1.0, 0.0]), np.inf, 0.0, "exact", none, none)
    far = sp.ProvedPoint(np.array([2.0, 0.0]), np.inf, 0.0, "exact", none, none)
    options = sp.Options(effort="auto", refine="none", time_limit=1.0)
    low, high = sp.solve_each(disc, [x, -x], options, points=[point, far])
    assert high.upper_bound == pytest.approx(-1.0)
    assert low.upper_bound == pytest.approx(1.0)


class TestBands:
    """Bands hold the true map and the true signals, and say what they are."""

    def result(self) -> tuple[setid.Simulated, setid.Identification]:
        model, _, _ = CASES["hammerstein"]
        truth = simulated("hammerstein", 0.05)
        return truth, setid.identify(truth.data, model, noise_of(truth), (), QUICK)

    def test_of_maps(self) -> None:
        _, result = self.result()
        x = np.linspace(-1, 1, 5)
        true = x + 0.4 * x**2 - 0.3 * x**3
        wide = setid.static_band(result, x=x)
        tight = setid.static_band(result, x=x[:2], time_limit=0.5)
        inner = setid.static_band(result, x=x, kind="sampled")
        assert wide.kind == "proved"
        assert inner.kind == "sampled"
        assert np.all((wide.low <= true) & (true <= wide.high))
        assert np.all((tight.low <= true[:2]) & (true[:2] <= tight.high))
        assert np.all((wide.low <= inner.low) & (inner.high <= wide.high))
        assert np.all(tight.high <= wide.high[:2])
        with pytest.raises(setid.ModelError, match="name: found 'v'"):
            setid.static_band(result, "v")

    def test_of_signals_and_pictures(self) -> None:
        from setid.plots.blocks import plot_diagram

        truth, result = self.result()
        u = truth.u[:, 0]
        true = u + 0.4 * u**2 - 0.3 * u**3
        band = setid.signal_band(result, "w")
        assert np.all((band.low <= true) & (true <= band.high))
        labels = band.plot().get_legend_handles_labels()[1]
        assert labels == ["proved", "sampled"]
        assert setid.static_band(result).plot().get_legend_handles_labels()[1][0] == "proved"
        texts = [t.get_text() for t in plot_diagram(result.formulation.model, result).texts]
        assert any("gamma2 in [" in text for text in texts)
        assert any("gamma1 = 1" in text for text in texts)

    @pytest.mark.parametrize("form", ["auto", "partial"])
    def test_of_a_map_of_an_output(self, form: str) -> None:
        """Lur'e: y = .5 y(k-1) + u(k-1) - w(k-1), w = .2 y^2; y is found before w."""
        rng = np.random.default_rng(3)
        u, y = rng.uniform(-1, 1, 25), np.zeros(25)
        for k in range(1, 25):
            y[k] = 0.5 * y[k - 1] + u[k - 1] - 0.2 * y[k - 1] ** 2
        linear = setid.TransferFunction(1, 1, 1)
        model = setid.Lure(linear, 2, normalise="nolinear", form=form)
        np.testing.assert_allclose(
            setid.simulate(model, {"a1": -0.5, "b1": 1.0, "gamma2": 0.2}, u)[:, 0], y, atol=1e-14
        )
        data = setid.IOData(u, y + 0.01 * rng.uniform(-1, 1, 25))
        noise = setid.Noise(output=0.01)
        result = setid.identify(data, model, noise, setid.Stable(), QUICK)
        assert result.intervals["gamma2"].outer[0] <= 0.2 <= result.intervals["gamma2"].outer[1]
        band = setid.signal_band(result, "w")
        assert np.all((band.low <= 0.2 * y**2) & (0.2 * y**2 <= band.high))
        assert np.all(band.high - band.low < 0.1)
        known = ~np.isnan(band.sampled_low)
        assert known.sum() > 20
        assert np.all((band.low <= band.sampled_low + 1e-9)[known])
        assert np.all((band.sampled_high <= band.high + 1e-9)[known])

    @pytest.mark.parametrize("seed", [0, 1])
    def test_of_a_map_of_noisy_inputs(self, seed: int) -> None:
        """y = .8 w(k-1), w = u + .3 u^2, with readings of u that are .05 off."""
        rng = np.random.default_rng(seed)
        u = rng.uniform(-1, 1, 20)
        w = u + 0.3 * u**2
        data = setid.IOData(u + 0.05 * rng.choice([-1.0, 1.0], 20), np.append(0, 0.8 * w[:-1]))
        model = setid.Hammerstein(setid.TransferFunction(0, 1, 1), 2, normalise="gamma1")
        noise = setid.Noise(output=1e-3, input=0.0501)
        result = setid.identify(data, model, noise, setid.Box({"b1": (0, 3)}), QUICK)
        assert "w" not in result.formulation.layout.groups
        band = setid.signal_band(result, "w")
        assert np.all((band.low <= w) & (w <= band.high)) and np.all(band.high - band.low < 0.5)
        assert np.all((band.low <= band.sampled_low) & (band.sampled_high <= band.high))
        theta, xi = (result.formulation.layout.group(name) for name in ("theta", "xi"))
        for x in result.witnesses:
            true = data.u[:, 0] - x[xi[:, 0]]
            value = true + x[theta[1]] * true**2
            known = xi[:, 0] >= 0
            assert np.all((band.sampled_low <= value + 1e-9)[known])
            assert np.all((value - 1e-9 <= band.sampled_high)[known])

    def test_of_a_map_with_a_negative_coefficient(self) -> None:
        """Readings say nothing here: w = u + gamma2 u^2 for each gamma2 from -1 to 0."""
        rng = np.random.default_rng(2)
        data = setid.IOData(rng.uniform(-1, 1, 12), rng.uniform(-1, 1, 12))
        model = setid.Hammerstein(setid.TransferFunction(0, 1, 1), 2, normalise="gamma1")
        noise, given = setid.Noise(output=100.0, input=0.2), {"b1": (0, 3), "gamma2": (-1, 0)}
        band = setid.signal_band(setid.identify(data, model, noise, setid.Box(given), QUICK), "w")
        for gamma in (-1.0, -0.5, 0.0):
            for u in data.u[:, 0] + np.array([[-0.2], [0.0], [0.2]]):
                w = u + gamma * u**2
                assert np.all((band.low <= w) & (w <= band.high))

    def test_of_coefficients_that_cancel(self) -> None:
        """1e9 u^3 - 1e7 u^5 + b u: near u = 10 doubles are 1e-4 off, and the band is narrower."""
        model = setid.BlockStructured(
            {("y1", "w"): setid.TransferFunction(0, 1, 0)},
            {"w": StaticMap("u1", [(3,), (5,), (1,)])},
            normalise={"gamma1": 1e9, "gamma2": -1e7, "b0": 1.0},
        )

        def exact(v: float, gain: Fraction) -> Fraction:
            return 10**9 * Fraction(v) ** 3 - 10**7 * Fraction(v) ** 5 + gain * Fraction(v)

        u = np.linspace(0.1, 1.0, 12)
        data = setid.IOData(u, [float(exact(v, Fraction(1))) for v in u.tolist()])
        result = setid.identify(data, model, setid.Noise(output=1e-6), options=QUICK)
        gains = [Fraction(end) for end in result.intervals["gamma3"].inner]
        x = np.linspace(9.99, 10.01, 40)
        band = setid.static_band(result, x=x)
        for low, high, v in zip(band.low.tolist(), band.high.tolist(), x.tolist(), strict=True):
            assert all(low <= exact(v, gain) <= high for gain in gains)
        near = setid.static_band(result, x=[1e-200, -1e-17, 0.0])  # fifth powers underflow
        assert np.all(np.abs([near.low, near.high]) < 1e-15)
        for low, high, v in zip(
            near.low.tolist(), near.high.tolist(), near.x[:, 0].tolist(), strict=True
        ):
            assert all(low <= exact(v, gain) <= high for gain in gains)

    def test_of_many_fixed_coefficients(self) -> None:
        """2^30 + 12 (.49 2^-22) - 2^30 at u = 0: a sum of doubles loses each small number."""
        small = 0.49 * 2.0**-22
        fixed = [2.0**30, *[small] * 12, -(2.0**30)]
        functions = [lambda u, k=k: np.cos((k + 1) * u) for k in range(len(fixed))]
        model = setid.BlockStructured(
            {("y1", "w"): setid.TransferFunction(0, 1, 0)},
            {"w": StaticMap("u1", [*functions, (1,)])},
            normalise={f"gamma{k + 1}": value for k, value in enumerate(fixed)} | {"b0": 1.0},
        )
        data = setid.IOData([0.0, 1.0, -1.0], [0.0, 5.0, -5.0])
        result = setid.identify(
            data, model, setid.Noise(output=1e12), setid.Box({"gamma15": (0, 1)})
        )
        band = setid.static_band(result, x=[0.0])
        exact = Fraction(small) * 12
        assert band.low[0] <= exact <= band.high[0]

    @pytest.mark.parametrize(("x", "value"), [((1e-170, 1e170), 1.0), ((0.0, 1e170), 0.0)])
    def test_of_products_that_underflow(self, x: tuple[float, float], value: float) -> None:
        """(u1 u2)^2 + gamma u1: the first square is below all doubles."""
        model = setid.BlockStructured(
            {("y1", "w"): setid.TransferFunction(0, 1, 0)},
            {"w": StaticMap(["u1", "u2"], [(2, 2), (1, 0)])},
            inputs=2,
            normalise={"gamma1": 1.0, "b0": 1.0},
        )
        u = np.array([[1.0, 0.5], [0.3, -1.0], [-0.6, 0.2]])
        data = setid.IOData(u, (u[:, 0] * u[:, 1]) ** 2 + u[:, 0])
        result = setid.identify(data, model, setid.Noise(output=0.1), options=QUICK)
        band = setid.static_band(result, x=[x])
        assert band.low[0] <= value <= band.high[0]


@pytest.mark.parametrize(
    ("name", "what"),
    [("hammerstein", "rows with products of parameters"), ("wiener", r"internal signals \(z\)")],
)
def test_what_needs_rows_linear_in_the_parameters_says_why_there_are_none(
    name: str, what: str
) -> None:
    model, _, priors = CASES[name]
    truth = simulated(name, 0.01, 15)
    options = setid.Options(time_limit=1.0, progress=False)
    result = setid.identify(truth.data, model, noise_of(truth), priors, options)
    affine = (setid.predict, setid.residuals, setid.step_band)
    for asked in (setid.projection_estimate, *(affine if name == "wiener" else ())):
        with pytest.raises(setid.SetidError, match=f"{what} have no") as caught:
            asked(result)
        assert "common" not in str(caught.value)
    if name == "hammerstein":  # sums of products make these rows affine
        assert len(setid.residuals(result).row) == 14
    with pytest.raises(setid.ModelError, match=f"{what} are not linear .* errors='output' takes"):
        setid.least_squares(truth.data, model)


def test_wrong_arguments_are_named() -> None:
    from setid.plots.blocks import plot_diagram

    model, u = CASES["hammerstein"][0], np.random.default_rng(1).uniform(-1, 1, 12)
    truth = setid.simulate_record(ONE, [-0.5, 0.8], u, setid.Noise(output=0.01))
    options = setid.Options(time_limit=3.0, progress=False)
    linear = setid.identify(truth.data, ONE, setid.Noise(equation=0.1), (), options)
    truth = simulated("hammerstein", 0.01, 15)
    result = setid.identify(truth.data, model, noise_of(truth), (), options)
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: setid.convert(ONE, [1.0, 2.0], "b1"), "model: found TransferFunction"),
        (lambda: setid.equivalent(ONE, [1.0, 2.0], [1.0, 2.0]), "model: found TransferFunction"),
        (lambda: setid.convert(model, [1.0], "b1"), "theta: found shape"),
        (lambda: setid.equivalent(model, [-0.7, 0.8, 0.4, 0.3], [1.0]), "theta: found shape"),
        (lambda: setid.BlockStructured("abc", {}), "linear: found str, expected a mapping"),
        (lambda: setid.BlockStructured({("y1", "u1"): ONE}, 3), "nonlinear: found int"),
        (lambda: StaticMap(3, 2), "StaticMap.arguments: found int, expected names"),
        (lambda: setid.discretisation_error(model, [1.0], u), "model: found Hammerstein"),
        (lambda: plot_diagram(ONE), "model: found TransferFunction, expected a block structure"),
        (lambda: setid.static_band(result, x=[np.nan]), r"x: found NaN at \[0\]"),
        (lambda: setid.static_band(result, x=[1.0], time_limit="a"), "time_limit: found 'a'"),
        (lambda: setid.static_band(result, x=[1.0], time_limit=-1.0), "time_limit: found -1.0"),
        (lambda: setid.frequency_band(linear, executor=4), "executor: found 4"),
        (lambda: setid.sensitivity(linear, [1.0], executor="x"), "executor: found 'x'"),
    ]
    given, other = (truth.data, model, noise_of(truth)), sp.Options()
    gain = setid.Physical({"K": (0.1, 9.0)}, ["b1 = K*(1 + a1)"])
    continuous = setid.ContinuousTransferFunction(1, 0)
    for asked in (
        lambda: setid.identify(*given, (), other),
        lambda: setid.consistency(*given, (), other),
        lambda: setid.fit(*given[:2], options=other),
        lambda: setid.select(truth.data, setid.TransferFunction, given[2], [1], options=other),
        lambda: setid.sensitivity(linear, [1.0], other),
        lambda: setid.reparametrise(linear, gain, other),
        lambda: setid.estimate_delta(truth.data, continuous, given[2], options=other),
    ):
        wrong.append((asked, "options: found Options, expected"))
    for call, message in wrong:
        with pytest.raises(setid.SetidError, match=message):
            call()


def test_samples_of_internal_signals_are_not_bounded_when_time_is_over() -> None:
    from setid.proofs.cells.output_cells import cell_box

    truth = simulated("wiener", 0.01)
    known = setid.formulate(truth.data, CASES["wiener"][0], noise_of(truth), [setid.Stable()])
    p, begin = len(known.parameters), time.monotonic()
    start = np.array([known.problem.lower[:p], known.problem.upper[:p]])
    whole, late = cell_box(known, start, rounds=3), cell_box(known, start, until=begin)
    assert np.all(np.isfinite([whole.low, whole.high])) and whole.verify(known, start)
    assert np.all(late.low == -np.inf) and np.all(late.high == np.inf)
    assert late.verify(known, start)
    assert not replace(late, low=whole.high).verify(known, start)
    few = replace(whole, low=late.low, high=late.high)  # of the parameters alone
    assert few.verify(known, start)


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
def test_exact_samples_among_noisy_ones_have_finite_weights(unit: float) -> None:
    rng = np.random.default_rng(229)
    u = rng.uniform(-1, 1, 20)
    model = setid.BlockStructured(
        {("z", "u1"): G(1, 1, 1), ("y1", "w"): G(1, 1, 1)},
        {"w": setid.StaticMap("z", 2)},
        normalise=["b[z,u1]1", "gamma1"],
        initial="zero",
    )
    theta = [0.8, 0.5, 0.6 * unit, 0.9]
    y = setid.simulate(model, theta, u) * (1 + 1e-4 * rng.uniform(-1, 1, (20, 1)))
    noise = setid.Noise(output=1.1e-4, relative=True)  # the first readings are zero, and exact
    formulation = setid.formulate(setid.IOData(u, y), model, noise, [setid.Stable()])
    box = box_of(formulation)
    assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert np.all(box.upper - box.lower < [0.1, 0.1, 0.1 * unit, 0.1])


def test_basis_functions_that_return_no_numbers_are_named() -> None:
    model = setid.Hammerstein(setid.TransferFunction(1, 1), [1, lambda u: "a"], normalise="gamma1")
    data = setid.IOData([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    with pytest.raises(setid.ModelError, match=r"StaticMap\.basis\[1\]: value: found str 'a'"):
        setid.formulate(data, model, setid.Noise(output=1.0))


def test_a_block_that_subtracts_an_input_is_not_its_transfer_function() -> None:
    """y = G (u1 - u2): the response from u2 is -G, and no band says that it is G."""
    model = setid.BlockStructured({("y1", "u1 - u2"): ONE}, {}, inputs=2)
    u = np.random.default_rng(4).uniform(-1, 1, (15, 2))
    truth = setid.simulate_record(model, [-0.5, 0.8], u, setid.Noise(equation=0.01))
    result = setid.identify(truth.data, model, setid.Noise(equation=0.01))
    band = setid.frequency_band(result, [0.5])
    g = 0.8 / (np.exp(0.5j) - 0.5)
    assert band.magnitude[0, 0] <= abs(g) <= band.magnitude[0, 1]
    step = setid.step_band(result, 3, input=2)
    assert step.high[1] < 0  # the step response has the sign
    gain = setid.DCGain(1, 2, input=2)
    for asked in (
        lambda: setid.frequency_band(result, [0.5], input=2),
        lambda: setid.to_control(result),
        lambda: ureal_script(result),
        lambda: setid.formulate(truth.data, model, setid.Noise(equation=0.01), gain),
    ):
        with pytest.raises(setid.ModelError, match="u1-u2.*expected a linear block to y1 that add"):
            asked()


def test_the_only_block_is_not_that_of_other_channels() -> None:
    """w = N(u1, u2), y = G w: neither G is the response of an input, nor [G G] the model."""
    model = setid.BlockStructured(
        {("y1", "w"): ONE},
        {"w": StaticMap(["u1", "u2"], [(1, 0), (1, 1)])},
        inputs=2,
        normalise="gamma1",
    )
    for input in (1, 2):
        assert model.transfer(1, input).denominator == ("a1",)  # for priors on its poles
    transfer_of(model, 1, 1)
    with pytest.raises(setid.ModelError, match="expected a linear block to y1 that adds u2"):
        transfer_of(model, 1, 2)
    other = setid.BlockStructured({("y1", "u2"): ONE}, {}, inputs=2)
    with pytest.raises(setid.ModelError, match="expected a linear block to y1 that adds u1"):
        transfer_of(other, 1, 1)


LOOPS = {
    "y1 = G(u1 - y1)": {("y1", "u1 - y1"): ONE},
    "y1 = G(u1 + w), w = H(y1)": {("y1", "u1 + w"): ONE, ("w", "y1"): ONE},
    "y1 = G(u1) + H(w), w = F(u1)": {("y1", "u1"): ONE, ("y1", "w"): ONE, ("w", "u1"): ONE},
    "y1 = G(u1 + u1)": {("y1", "u1 + u1"): ONE},
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_block_is_not_the_response_where_its_input_acts_in_another_way_too(name: str) -> None:
    model = setid.BlockStructured(LOOPS[name], {})
    with pytest.raises(setid.ModelError, match="by which u1 acts on y1 in another way too"):
        transfer_of(model, 1, 1)


def test_the_response_of_a_loop_is_not_that_of_its_block() -> None:
    """y = G (u - y) with G = 0.4 / (z - 0.5): the loop has the static gain 0.8 / 1.8."""
    model = setid.BlockStructured({("y1", "u1 - y1"): setid.TransferFunction(1, 1, 1)}, {})
    u = np.random.default_rng(4).uniform(-1, 1, 25)
    truth = setid.simulate_record(model, [-0.5, 0.4], u, setid.Noise(equation=0.001))
    result = setid.identify(truth.data, model, setid.Noise(equation=0.001))
    step = setid.step_band(result, 60)
    assert step.low[-1] <= 0.8 / 1.8 <= step.high[-1] < 0.5
    gain = setid.DCGain(0.7, 0.9)
    for asked in (
        lambda: setid.frequency_band(result, [0.5]),
        lambda: setid.to_control(result),
        lambda: ureal_script(result),
        lambda: setid.formulate(truth.data, model, setid.Noise(equation=0.01), gain),
    ):
        with pytest.raises(setid.ModelError, match="y1 = G.u1-y1.*step_band gives the whole"):
            asked()


def test_feedback_through_maps_is_left_out_of_the_linear_block() -> None:
    assert transfer_of(setid.Lure(ONE, 2, normalise="gamma1"), 1, 1).denominator == ("a1",)
    coupled = setid.BlockStructured(
        {("y1", "u1"): ONE, ("y1", "y2"): ONE, ("y2", "u2"): ONE}, {}, inputs=2, outputs=2
    )
    assert transfer_of(coupled, 1, 1).denominator == ("a[y1,u1]1",)


def test_channels_between_which_nothing_acts_are_said_to_have_the_response_zero() -> None:
    model = setid.BlockStructured(
        {("y1", "u1"): ONE, ("y2", "u2"): ONE, ("y2", "y1"): ONE}, {}, inputs=2, outputs=2
    )
    with pytest.raises(setid.ModelError, match="found nothing from u2 to y1, a response that is "):
        transfer_of(model, 1, 2)
    with pytest.raises(setid.ModelError, match="found 0 linear blocks from u1 to y2"):
        transfer_of(model, 2, 1)  # by way of y1


def test_the_script_for_matlab_says_that_maps_are_left_out() -> None:
    truth = simulated("hammerstein", 0.01, 15)
    model, _, priors = CASES["hammerstein"]
    options = setid.Options(time_limit=3.0, progress=False)
    result = setid.identify(
        truth.data, model.normalised("gamma1"), noise_of(truth), priors, options
    )
    script = ureal_script(result)
    assert "every consistent linear block is in G" in script
    assert "% G is the linear block: static maps and feedback are left out.\n" in script


def test_a_box_for_which_time_ended_is_not_blamed_on_the_data() -> None:
    """With more time the cells of this Wiener system give a finite box."""
    rng = np.random.default_rng(0)
    u, z = rng.uniform(-1, 1, 25), np.zeros(25)
    for k in range(1, 25):
        z[k] = 0.5 * z[k - 1] + u[k - 1]
    data = setid.IOData(u, z + 0.3 * z**2)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    short = setid.Options(time_limit=1e-3, progress=False)
    noise, prior = setid.Noise(output=0.01), setid.Stable()
    text = " ".join(setid.identify(data, model, noise, prior, short).notes)
    assert "give more time" in text and "no finite bounds" not in text
    result = setid.identify(data, model, noise, prior, QUICK)
    assert all(np.all(np.isfinite(item.outer)) for item in result.intervals.values())
