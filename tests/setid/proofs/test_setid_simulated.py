"""Simulations over regions of the parameters: forms against exact rational replay, trees forged."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import setid
from setid.proofs.block_bands import simulated_ends
from setid.proofs.cells.arithmetic import Enclosed, fitted, rows_of
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.parameter_box import start_of
from setid.proofs.simulated.forms import (
    Form,
    Region,
    _through,
    constant,
    filtered,
    late,
    plus,
    times,
)
from setid.proofs.simulated.outputs import half_spaces, recursion_of
from setid.proofs.simulated.tree import SimulatedBox, Step, TreeNode, split_region, tightened
from setid.result.json_parts import read, write
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox

NORMS = ["b[z,u1]1", "gamma1"]
TRUTH = (-0.4, -0.5, 0.8, 0.3)
QUICK = setid.Options(tol=0.05, time_limit=60.0, progress=False)


def cascade(normalise=NORMS, initial: str = "zero") -> setid.BlockStructured:
    """z = G u, w = gamma1 z + gamma2 z^2, y = H w, both blocks of order one."""
    shape = setid.TransferFunction(1, 1, 1)
    blocks = {("z", "u1"): shape, ("y1", "w"): shape}
    maps = {"w": setid.StaticMap("z", 2)}
    return setid.BlockStructured(blocks, maps, normalise=normalise, initial=initial)


def exact_signals(theta, u) -> dict[str, list[Fraction]]:
    """Signals of the cascade in rationals, written down from its equations."""
    a, c, b, gamma = (Fraction(float(v)) for v in theta)
    z = w = y = Fraction(0)
    found: dict[str, list[Fraction]] = {"z": [], "w": [], "y1": []}
    for k in range(len(u)):
        before = w
        z = -a * z + (Fraction(float(u[k - 1])) if k else 0)
        w = z + gamma * z * z
        y = -c * y + b * before
        for name, value in zip(found, (z, w, y), strict=True):
            found[name].append(value)
    return found


def exact_outputs(theta, u) -> list[Fraction]:
    return exact_signals(theta, u)["y1"]


def record(samples: int = 30, noise: float = 0.01, seed: int = 1, theta=TRUTH) -> setid.IOData:
    random = np.random.default_rng(seed)
    u = random.uniform(-1.0, 1.0, samples)
    y = np.array([float(v) for v in exact_outputs(theta, u)])
    return setid.IOData(u, y + noise * random.uniform(-1.0, 1.0, samples))


def formulated(data: setid.IOData, priors=None, noise: float = 0.01, **options):
    given = [setid.Stable()] if priors is None else priors
    return setid.formulate(data, cascade(**options), setid.Noise(output=noise), given)


def region_of(middle, radius, directions=None) -> Region:
    middle = np.asarray(middle, float)
    w = np.zeros((0, middle.size)) if directions is None else np.asarray(directions, float)
    lower, upper = middle - radius, middle + radius
    spread = np.abs(w) @ np.maximum(upper - middle, middle - lower)
    return Region(lower, upper, w, w @ middle - 0.4 * spread, w @ middle + 0.4 * spread)


def off(exact: Fraction, form: Form, k: int, theta, region: Region) -> Fraction:
    """How far an exact value lies from the affine part of a form."""
    linear = Fraction(float(form.value[k]))
    for slope, t, m in zip(form.slope[k], theta, region.middle, strict=True):
        linear += Fraction(float(slope)) * (Fraction(float(t)) - Fraction(float(m)))
    return abs(exact - linear)


# ---- forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.0, 1e-9, 1e-3, 0.05])
def test_exact_outputs_lie_within_the_forms(radius: float) -> None:
    data = record(20)
    parts, region = recursion_of(formulated(data)), region_of(TRUTH, radius)
    form, random = parts.run(region)["y1"], np.random.default_rng(0)
    corners = [region.lower, region.upper, *random.uniform(region.lower, region.upper, (12, 4))]
    for theta in corners:
        for k, exact in enumerate(exact_outputs(theta, data.u[:, 0])):
            assert off(exact, form, k, theta, region) <= Fraction(float(form.rest[k]))
    assert (
        np.max(form.rest) < 1e-12 if radius == 0.0 else np.max(form.rest) < 40 * radius**2 + 1e-13
    )


@pytest.mark.parametrize("radius", [0.0, 1e-9, 1e-3, 0.05])
@pytest.mark.parametrize("name", ["z", "w"])
def test_ends_of_internal_signals_hold_exact_values(name: str, radius: float) -> None:
    data, region = record(20), region_of(TRUTH, radius)
    low, high = simulated_ends(formulated(data), name, (region.lower, region.upper))
    corners = [*itertools.product(*zip(region.lower, region.upper, strict=True)), TRUTH]
    values = [exact_signals(theta, data.u[:, 0])[name] for theta in corners]
    for k, exact in enumerate(zip(*values, strict=True)):
        assert Fraction(low[k]) <= min(exact) and max(exact) <= Fraction(high[k])
        assert high[k] - low[k] <= 2.0 * float(max(exact) - min(exact)) + 1e-13


def test_signals_without_a_bounded_box_have_no_simulated_ends() -> None:
    assert simulated_ends(formulated(record(20)), "z", (np.full(4, -np.inf), np.ones(4))) is None


def test_thin_regions_have_smaller_rests() -> None:
    data = record(20)
    parts = recursion_of(formulated(data))
    w = np.array([[1.0, 1.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0], [0, 0, 1, 1], [0, 0, 1, -1]])
    thin, wide = region_of(TRUTH, 0.02, w), region_of(TRUTH, 0.02)
    narrow, broad = (parts.run(r)["y1"].rest for r in (thin, wide))
    assert np.all(narrow <= broad * (1 + 1e-9))
    assert narrow.max() < 0.7 * broad.max()
    form, random = parts.run(thin)["y1"], np.random.default_rng(4)
    for theta in random.uniform(thin.lower, thin.upper, (400, 4)):
        if np.all((thin.low <= w @ theta) & (w @ theta <= thin.high)):
            for k, exact in enumerate(exact_outputs(theta, data.u[:, 0])):
                assert off(exact, form, k, theta, thin) <= Fraction(float(form.rest[k]))


def test_the_reach_is_that_of_the_vertices() -> None:
    # |x + y| <= 0.1 and |x - y| <= 2 in the square [-1, 1]^2: x + y = 0.1 at most, not 2;
    # 2 x - y = 0.5 (x + y) + 1.5 (x - y) is 3.05 at most, and 3 in the square
    w = np.array([[1.0, 1.0], [1.0, -1.0]])
    region = Region(-np.ones(2), np.ones(2), w, np.array([-0.1, -2.0]), np.array([0.1, 2.0]))
    found = region.reach(np.array([[2.0, -1.0], [1.0, 1.0], [1.0, 0.0]]))
    assert found == pytest.approx([3.0, 0.1, 1.0], rel=1e-9)
    assert np.all(region.spread(np.array([[2.0, -1.0]])) >= 3.0)


def test_the_reach_is_not_that_of_one_side() -> None:
    # 0 <= x + y <= 0.1 stated as [-0.1, 0.1] and [0, 0.3]: the middle has x + y = 0.075
    # by the mean of both, so that x + y moves by up to 0.075
    w = np.array([[1.0, 1.0], [1.0, 1.0]])
    region = Region(-np.ones(2), np.ones(2), w, np.array([-0.1, 0.0]), np.array([0.1, 0.3]))
    assert region.middle.sum() == pytest.approx(0.075)
    assert region.reach(np.array([[1.0, 1.0]]))[0] >= 0.075


def test_directions_say_nothing_across_them() -> None:
    # |x + y| <= 0.1 in the square [-1, 1]^2 lets x go from -1 to 1
    w = np.array([[1.0, 1.0]])
    region = Region(-np.ones(2), np.ones(2), w, np.array([-0.1]), np.array([0.1]))
    found = region.reach(np.array([[1.0, 0.0], [1.0, 1.0]]))
    assert found == pytest.approx([1.0, 0.1], rel=1e-9) and found[0] >= 1.0


def test_numbers_that_are_fixed_act() -> None:
    data = record(12)
    model = cascade({"b[z,u1]1": 1.0, "gamma1": 2.0})
    given = setid.formulate(data, model, setid.Noise(output=0.01), [setid.Stable()])
    region = region_of((-0.4, -0.5, 0.4, 0.6), 0.0)  # 0.4 (2 z + 0.6 z^2) is 0.8 (z + 0.3 z^2)
    form = recursion_of(given).run(region)["y1"]
    exact = [float(v) for v in exact_outputs(TRUTH, data.u[:, 0])]
    assert form.value == pytest.approx(exact, abs=1e-13)


def test_products_and_sums_of_forms_hold_exact_values() -> None:
    # (1 + 3 x)(2 - x) = 2 + 5 x - 3 x^2 and |x| <= 1/2: the rest is 3/4
    region = Region(np.array([-0.5]), np.array([0.5]), np.zeros((0, 1)), np.zeros(0), np.zeros(0))
    first = Form(np.ones(1), np.array([[3.0]]), np.zeros(1))
    second = Form(np.array([2.0]), np.array([[-1.0]]), np.zeros(1))
    found = times(first, second, region)
    assert (found.value[0], found.slope[0, 0]) == (2.0, 5.0)
    assert 0.75 <= found.rest[0] < 0.75 * (1 + 1e-9)
    total = plus(found, first, region)
    assert (total.value[0], total.slope[0, 0]) == (3.0, 8.0)
    assert 0.75 <= total.rest[0] < 0.75 * (1 + 1e-9)
    # rests multiply too: (1 + r)(2 - x + s), |r| <= 0.1, |s| <= 0.2 leaves 0.2 + .05 + 0.2 + .02
    loose = Form(np.ones(1), np.zeros((1, 1)), np.array([0.1]))
    other = second._replace(rest=np.array([0.2]))
    assert times(loose, other, region).rest[0] == pytest.approx(0.1 * 2.5 + 0.2 + 0.02, rel=1e-9)
    tenth = constant(np.array([0.1]), 1)
    exact = Fraction(0.1) * Fraction(0.1)
    product = times(tenth, tenth, region)
    assert 0 < abs(exact - Fraction(float(product.value[0]))) <= Fraction(float(product.rest[0]))
    total = plus(constant(np.array([1.0]), 1), constant(np.array([1e-20]), 1), region)
    assert total.rest[0] >= 1e-20


def test_late_forms_rest_before_the_record() -> None:
    form = Form(np.array([1.0, 2.0, 3.0]), np.ones((3, 1)), np.ones(3))
    found = late(form, 2)
    assert found.value.tolist() == [0.0, 0.0, 1.0] and found.rest.tolist() == [0.0, 0.0, 1.0]
    assert found.slope.ravel().tolist() == [0.0, 0.0, 1.0] and late(form, 0) is form


def test_what_grows_beyond_all_doubles_overflows() -> None:
    """s(k) = -4 s(k-1) from 1 is (-4)^k, and its slope k (-4)^(k-1) times -1."""
    impulse = constant(np.eye(1200)[0], 1)
    pole = Form(np.array(4.0), np.ones(1), np.array(0.0))
    with np.errstate(over="ignore", invalid="ignore"):
        form = filtered([(1, pole)], impulse, region_of([4.0], 0.0), bounded=False)
    k = np.arange(500)
    assert np.array_equal(form.value[:500], (-4.0) ** k)
    assert np.allclose(form.slope[1:500, 0], -k[1:] * (-4.0) ** (k[1:] - 1), rtol=1e-12)
    assert not np.any(np.isfinite(form.value[520:]))


@pytest.mark.parametrize("radius", [0.0, 0.01, 0.1])
def test_filtered_forms_hold_recursions_of_order_two(radius: float) -> None:
    random, middle = np.random.default_rng(3), np.array([-1.5, 0.7])
    region = region_of(middle, radius)
    drive = constant(random.uniform(-1.0, 1.0, 25), 2)
    drive = drive._replace(rest=np.full(25, 0.01))
    poles = [(i + 1, Form(region.middle[i], np.eye(2)[i], np.array(0.0))) for i in range(2)]
    form = filtered(poles, drive, region)
    assert np.all(np.isfinite(form.rest))
    for _ in range(30):
        theta = random.choice(np.array([region.lower, region.upper]).T.ravel(), 2)
        theta = np.clip(theta, region.lower, region.upper)
        a = [Fraction(float(v)) for v in theta]
        s: list[Fraction] = []
        for k in range(25):
            push = Fraction(float(drive.value[k])) + Fraction(float(random.choice([-1, 1])) / 100)
            s.append(push - sum(a[i] * s[k - i - 1] for i in range(2) if k > i))
            assert off(s[k], form, k, theta, region) <= Fraction(float(form.rest[k]))


# ---- rows ---------------------------------------------------------------------------------


def test_rows_hold_for_consistent_parameters_and_cut_others() -> None:
    data = record(30)
    formulation = formulated(data)
    parts, region = recursion_of(formulation), region_of(TRUTH, 0.02)
    spaces = half_spaces(formulation, parts, region)
    assert np.all(spaces.matrix @ np.array(TRUTH) <= spaces.right)
    assert not np.all(spaces.matrix @ region.upper <= spaces.right)
    # where a simulation in rationals is consistent, all rows hold
    random, count = np.random.default_rng(8), 0
    for theta in np.array(TRUTH) + 0.002 * random.uniform(-1, 1, (100, 4)):
        errors = [
            float(v) - y
            for v, y in zip(exact_outputs(theta, data.u[:, 0]), data.y[:, 0], strict=True)
        ]
        if np.max(np.abs(errors)) <= 0.01:
            count += 1
            assert np.all(spaces.matrix @ theta <= spaces.right)
    assert count > 5


def test_rows_of_readings_are_no_wider_than_their_noise() -> None:
    # at a single point rows say |y~ - y| <= noise, nothing more
    data = record(12)
    formulation = formulated(data)
    region = region_of(TRUTH, 0.0)
    spaces = half_spaces(formulation, recursion_of(formulation), region)
    exact = np.array([float(v) for v in exact_outputs(TRUTH, data.u[:, 0])])
    gaps = (spaces.right - spaces.matrix @ np.array(TRUTH))[:24]
    wanted = np.concatenate([data.y[:, 0] - exact, exact - data.y[:, 0]]) + 0.01
    assert gaps == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(
    "noise",
    [setid.Noise(output=0.01, input=0.01), setid.Noise(output=0.01, equation=0.01)],
)
def test_other_errors_have_no_recursion(noise: setid.Noise) -> None:
    formulation = setid.formulate(record(), cascade(), noise, [setid.Stable()])
    assert recursion_of(formulation) is None


def test_unknown_pasts_have_no_recursion() -> None:
    assert recursion_of(formulated(record(), initial="free")) is None


# ---- trees --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return setid.identify(record(), cascade(), setid.Noise(output=0.01), setid.Stable(), QUICK)


def test_a_cascade_closes_from_stability_and_a_normalisation(result) -> None:
    for value, item in zip(TRUTH, result.intervals.values(), strict=True):
        assert item.outer[0] <= value <= item.outer[1]
        assert item.status == "certified" and item.gap <= 0.05
    assert result.verify()
    assert result.notes == ()


def test_progress_tells_proved_and_attained_ends(result) -> None:
    seen: dict[str, tuple] = {}
    setid.identify(
        record(),
        cascade(),
        setid.Noise(output=0.01),
        setid.Stable(),
        QUICK,
        on_progress=lambda name, outer, inner: seen.update({name: (outer, inner)}),
    )
    assert seen == {name: (i.outer, i.inner) for name, i in result.intervals.items()}


def test_attained_ends_simulate_within_the_noise(result) -> None:
    data = result.formulation.data
    for item in result.intervals.values():
        for point in item.witnesses:
            exact = exact_outputs(point[:4], data.u[:, 0])
            off = [abs(Fraction(float(y)) - v) for y, v in zip(data.y[:, 0], exact, strict=True)]
            assert max(off) <= Fraction(0.01)


def test_sampled_members_lie_in_the_box(result) -> None:
    data, box = result.formulation.data, result.box
    random, count = np.random.default_rng(11), 0
    width = box.upper - box.lower
    for theta in random.uniform(box.lower - 0.1 * width, box.upper + 0.1 * width, (3000, 4)):
        y = np.array(simulated_floats(theta, data.u[:, 0]))
        if np.max(np.abs(y - data.y[:, 0])) <= 0.01:
            count += 1
            assert np.all((box.lower <= theta) & (theta <= box.upper))
    assert count > 10


def simulated_floats(theta, u) -> list[float]:
    a, c, b, gamma = theta
    z = w = y = 0.0
    found = []
    for k in range(len(u)):
        z, y, w = -a * z + (u[k - 1] if k else 0.0), -c * y + b * w, 0.0
        w = z + gamma * z * z
        found.append(y)
    return found


def test_stored_results_are_verified_again(result) -> None:
    again = setid.Identification.from_json(result.to_json())
    assert again.verify() and again.box.leaves == result.box.leaves
    assert again.intervals["gamma2"].outer == result.intervals["gamma2"].outer


def forged(box, **parts):
    return replace(box, **parts)


def test_narrower_boxes_do_not_follow(result) -> None:
    box, formulation = result.box, result.formulation
    start = start_of(formulation)
    assert box.verify(formulation, start)
    width = box.upper - box.lower
    for place in range(4):
        shift = 1e-6 * width * (np.arange(4) == place)
        assert not forged(box, lower=box.lower + shift).verify(formulation, start)
        assert not forged(box, upper=box.upper - shift).verify(formulation, start)
    nothing = np.full(4, np.nan)
    assert not forged(box, lower=nothing).verify(formulation, start)


def test_damaged_trees_prove_no_more(result) -> None:
    box, formulation = result.box, result.formulation
    start, root = start_of(formulation), result.box.nodes[0]
    last = len(box.nodes) - 1
    damages = [
        (TreeNode(root.steps, root.split, root.at, (last + 1, last + 2)), *box.nodes[1:]),
        (TreeNode(root.steps, root.split, root.at, (0, 0)), *box.nodes[1:]),
        (TreeNode(root.steps, root.split, root.at, (1,)), *box.nodes[1:]),
        (TreeNode(root.steps, root.split, root.at, (1, -1)), *box.nodes[1:]),
        (TreeNode(root.steps), *box.nodes[1:]),
        (TreeNode((), root.split, root.at, root.children), *box.nodes[1:]),
        (TreeNode(root.steps, root.split, root.at + 0.5, root.children), *box.nodes[1:]),
        (),
    ]
    for nodes in damages:
        assert not forged(box, nodes=nodes).verify(formulation, start)
    for first in (None, forged(box.first, lower=box.first.lower + 0.01)):
        assert not forged(box, first=first).verify(formulation, start)
    open_ends = np.full(4, np.inf)
    for children, good in (((1, 2), True), ((1, 1), False)):  # which would double at each node
        nodes = TreeNode((), root.split, root.at, children), TreeNode(), TreeNode()
        wide = forged(box, lower=-open_ends, upper=open_ends, nodes=nodes)
        assert wide.verify(formulation, start) == good
    assert not forged(box, directions=box.directions[:, :3]).verify(formulation, start)
    assert not forged(box, directions=box.directions * np.nan).verify(formulation, start)
    other = formulated(record(seed=2))
    assert not box.verify(other, start_of(other))


def test_no_half_stands_for_both(result) -> None:
    """A tree that names the same half twice has lost the other one: it is malformed."""
    box, formulation = result.box, result.formulation
    nodes = list(box.nodes)
    root = nodes[0]
    for twice in (root.children[0], root.children[1]):
        nodes[0] = TreeNode(root.steps, root.split, root.at, (twice, twice))
        hull = forged(box, nodes=tuple(nodes))._hull
        assert hull(formulation, recursion_of(formulation), _root(box, formulation)) is None


def _root(box, formulation) -> Region:
    from setid.proofs.simulated.tree import first_region

    return first_region(formulation, box.first.lower, box.first.upper, box.directions)


def test_multipliers_of_any_kind_lose_no_member() -> None:
    data = record()
    formulation = formulated(data)
    parts, region = recursion_of(formulation), region_of(TRUTH, 0.01, np.eye(4)[:2] + 0.5)
    spaces = half_spaces(formulation, parts, region)
    random = np.random.default_rng(5)
    for _ in range(30):
        rows = random.choice(spaces.right.size, 6, replace=False)
        weights = random.normal(size=(13, 6)) * 10.0 ** random.integers(-3, 3)
        found = tightened(region, spaces, Step(rows, weights))
        assert found is not None
        assert np.all(found.lower <= TRUTH) and np.all(TRUTH <= found.upper)
        assert np.all(found.low <= found.directions @ TRUTH)
        assert np.all(found.directions @ TRUTH <= found.high)


def test_parts_of_a_region_cover_it() -> None:
    region = region_of(TRUTH, 0.1, np.eye(4)[:1] + 1.0)
    below, above = split_region(region, 1, -0.47)
    assert below.upper[1] == above.lower[1] == -0.47
    assert np.all(below.lower == region.lower) and np.all(above.upper == region.upper)
    middle = float(region.low[0] / 2 + region.high[0] / 2)
    below, above = split_region(region, 4, middle)
    assert below.high[0] == above.low[0] == middle
    assert np.all(below.upper == region.upper)
    assert split_region(region, 0, -5.0)[0] is None and split_region(region, 0, 5.0)[1] is None


def test_parts_of_the_evidence_are_written_and_read() -> None:
    step = Step(np.array([3, 1]), np.array([[0.5, -1.0]]))
    node = read(write(TreeNode((step,), 2, 0.25, (1, 2))))
    assert (node.split, node.at, node.children) == (2, 0.25, (1, 2))
    assert node.steps[0].rows.tolist() == [3, 1]
    assert not node.steps[0].weights.flags.writeable


# ---- cascades -----------------------------------------------------------------------------


# By hand: z' = k z and w' = l w take b_z' = k, gamma_m' = l gamma_m / k^m, b_y' = b_y / l.
EQUAL = [
    (NORMS, {"b[y1,w]1": 0.8, "gamma2": 0.3}),
    (["gamma1", "b[y1,w]1"], {"b[z,u1]1": 0.8, "gamma2": 0.375}),  # k = l = 4/5
    (
        ["dcgain[z,u1]", "gamma1"],
        {"b[z,u1]1": 0.6, "b[y1,w]1": 4 / 3, "gamma2": 0.5},
    ),  # k = l = 3/5
    ({"b[z,u1]1": 1.0, "gamma1": 2.0}, {"b[y1,w]1": 0.4, "gamma2": 0.6}),  # k = 1, l = 2
    (  # k = 2/5, l = 4/5
        {"gamma1": 2.0, "b[y1,w]1": 1.0},
        {"b[z,u1]1": 0.4, "gamma2": 1.5},
    ),
    (  # k = 3/5, l = 8/5
        ["dcgain"],
        {"b[z,u1]1": 0.6, "b[y1,w]1": 0.5, "gamma1": 8 / 3, "gamma2": 4 / 3},
    ),
]


@pytest.mark.parametrize(("normalise", "others"), EQUAL)
def test_cells_of_the_first_block_hold_the_truth(normalise, others) -> None:
    model, full = cascade(normalise), {"a[z,u1]1": -0.4, "a[y1,w]1": -0.5} | others
    widths = []
    for noise in (1e-2, 1e-4):
        data = record(30, noise)
        given = [setid.Stable()]
        formulation = setid.formulate(data, model, setid.Noise(output=noise), given)
        box = cell_box(formulation, start_of(formulation))
        theta = np.array([full[name] for name in formulation.parameters])
        assert np.all((box.lower <= theta) & (theta <= box.upper)), (box, theta)
        widths.append(np.max(box.upper - box.lower))
    assert widths[1] < 0.05 * widths[0]


def test_rows_with_past_readings_hold_all_noise() -> None:
    """y_k = -a y_(k-1) + gamma z_k with every pattern of extreme noise on the readings."""
    a, gamma, width = -0.5, 1.0, 0.02
    z = np.array([0.3, -0.7, 0.9, 0.2, -0.4, 0.8, -0.9])
    y = np.zeros(7)
    for k in range(7):
        y[k] = (0.5 * y[k - 1] if k else 0.0) + gamma * z[k]
    known = Enclosed(z[None, :], np.zeros((1, 7)), np.zeros((1, 0, 7)), np.zeros((1, 0)))
    rows, spread = np.arange(1, 7), np.full(6, width)
    largest = 0.0
    for signs in itertools.product([-1.0, 1.0], repeat=7):
        read = y + width * np.array(signs)
        past = -read[:-1, None], np.full((6, 1), width)
        found = fitted(rows_of(known, rows, ((0, 1),), past, read[1:], spread))
        assert found.bounded[0] and not found.empty[0]
        off = np.abs(found.gamma[0] - [a, gamma])
        assert np.all(off <= found.radius[0])
        largest = max(largest, float(np.max(off / found.radius[0])))
        exact = fitted(rows_of(known, rows, ((0, 1),), (past[0], 0 * past[1]), read[1:], spread))
        assert np.all(found.radius >= exact.radius + 0.2 * width)
    assert largest > 0.2


def test_the_gain_of_the_last_block_is_not_that_of_the_first() -> None:
    # k = l = 8/5: b_z = 8/5, b_y = 1/2, gamma2 = (8/5) (3/10) / (8/5)^2 = 3/16
    data, model = record(), cascade(["dcgain[y1,w]", "gamma1"])
    formulation = setid.formulate(data, model, setid.Noise(output=0.01), [setid.Stable()])
    box = cell_box(formulation, start_of(formulation))
    known = {"a[z,u1]1": -0.4, "a[y1,w]1": -0.5, "b[z,u1]1": 1.6, "b[y1,w]1": 0.5}
    theta = np.array([(known | {"gamma2": 0.1875})[name] for name in formulation.parameters])
    assert np.all((box.lower <= theta) & (theta <= box.upper)), box


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cells_allow_for_equation_errors(seed: int) -> None:
    """Errors at their bounds in y = gamma1 z + gamma2 z^2 + e, with hardly any output noise."""
    random = np.random.default_rng(seed)
    u, z = random.uniform(-1.0, 1.0, 30), np.zeros(30)
    for k in range(1, 30):
        z[k] = 0.4 * z[k - 1] + u[k - 1]
    basis = np.stack([z, z**2])
    error = 0.05 * np.sign(np.linalg.pinv(basis.T)[0])  # moves gamma1 as far as it can
    data = setid.IOData(u, 0.8 * z + 0.3 * z**2 + error)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="b1", initial="zero")
    noise = setid.Noise(output=1e-4, equation=0.05)
    formulation = setid.formulate(data, model, noise, [setid.Stable()])
    box = cell_box(formulation, start_of(formulation))
    truth = np.array([-0.4, 0.8, 0.3])
    assert not box.empty and np.all((box.lower <= truth) & (truth <= box.upper)), box


@pytest.mark.slow
def test_a_cascade_beside_a_linear_block_closes_on_a_box() -> None:
    random = np.random.default_rng(0)
    u, (z, v, x) = random.uniform(-1.0, 1.0, (25, 2)), np.zeros((3, 25))
    for k in range(1, 25):
        z[k] = 0.4 * z[k - 1] + u[k - 1, 0]
        v[k] = 0.5 * v[k - 1] + 0.8 * (z[k - 1] + 0.3 * z[k - 1] ** 2)
        x[k] = 0.3 * x[k - 1] + 0.6 * u[k - 1, 1]
    data = setid.IOData(u, v + x + 0.01 * random.uniform(-1.0, 1.0, 25))
    shape, maps = setid.TransferFunction(1, 1, 1), {"w": setid.StaticMap("z", 2)}
    blocks = {("z", "u1"): shape, ("y1", "w"): shape, ("y1", "u2"): shape}
    model = setid.BlockStructured(blocks, maps, inputs=2, normalise=NORMS, initial="zero")
    truth = {"a[z,u1]1": -0.4, "a[y1,w]1": -0.5, "b[y1,w]1": 0.8, "gamma2": 0.3}
    truth |= {"a[y1,u2]1": -0.3, "b[y1,u2]1": 0.6}
    box = setid.Box({n: (t - 0.2 * abs(t), t + 0.2 * abs(t)) for n, t in truth.items()})
    loose = setid.Options(tol=0.2, time_limit=60.0, progress=False)
    found = setid.identify(data, model, setid.Noise(output=0.01), [setid.Stable(), box], loose)
    assert found.verify()
    for name, item in found.intervals.items():
        assert truth[name] in item and item.inner is not None and item.gap <= 0.2


def test_missing_readings_are_left_out() -> None:
    data = record()
    y = data.y[:, 0].copy()
    y[[5, 11]] = np.nan
    gaps = setid.IOData(data.u, y)
    found = setid.identify(gaps, cascade(), setid.Noise(output=0.01), setid.Stable(), QUICK)
    assert found.verify()
    for value, item in zip(TRUTH, found.intervals.values(), strict=True):
        assert value in item and item.inner is not None


def test_boxes_from_products_may_come_before_simulations() -> None:
    shape, wave = setid.TransferFunction(1, 1, 1), np.random.default_rng(3)
    model = setid.BlockStructured(
        {("y1", "w"): shape, ("y1", "u2"): shape},
        {"w": setid.StaticMap("u1", 2)},
        inputs=2,
        normalise="gamma1",
        initial="zero",
        form="partial",
    )
    theta, noise = [-0.5, 0.3, 0.8, 0.6, 0.4], setid.Noise(output=0.05)
    truth = setid.simulate_record(model, theta, wave.uniform(-1, 1, (80, 2)), noise, seed=1)
    options = setid.Options(tol=0.2, time_limit=30, progress=False)
    found = setid.identify(truth.data, model, noise, setid.Stable(), options)
    assert isinstance(found.box, SimulatedBox) and isinstance(found.box.first, LiftedBox)
    ends = [item.outer for item in found.intervals.values()]
    assert all(low <= value <= high for (low, high), value in zip(ends, theta, strict=True))
    again = setid.Identification.from_json(found.to_json())  # which verifies
    assert again.outer_box[0].tolist() == found.outer_box[0].tolist()
    start, first = start_of(found.formulation), found.box.first
    for other in (None, replace(first, upper=first.upper - 0.01)):
        assert not forged(found.box, first=other).verify(found.formulation, start)


def test_records_of_other_systems_are_proved_empty() -> None:
    data = record()
    wrong = setid.IOData(data.u, data.y**3 + 0.2 * np.roll(data.y, 3, axis=0))
    found = setid.identify(wrong, cascade(), setid.Noise(output=0.01), setid.Stable(), QUICK)
    assert found.empty and found.verify()


def test_emptiness_is_not_claimed_where_the_truth_is(result) -> None:
    formulation, none = result.formulation, np.full(4, np.inf)
    empty = forged(result.box, lower=none, upper=-none)
    assert not empty.verify(formulation, start_of(formulation))


def test_a_limit_in_time_keeps_what_is_proved() -> None:
    limit = setid.Options(time_limit=0.3, progress=False)
    data = record(60, 0.05)
    found = setid.identify(data, cascade(), setid.Noise(output=0.05), setid.Stable(), limit)
    assert found.verify()
    for value, item in zip(TRUTH, found.intervals.values(), strict=True):
        assert value in item and np.all(np.isfinite(item.outer))


def test_responses_of_long_records_carry_the_rounding_of_their_sums() -> None:
    """Of 1 and many numbers that are lost beside it, one by one."""
    samples = 24_000
    size = np.full(samples, 2.0**-54)
    size[-1] = 1.0
    found = _through(np.ones(samples), size)
    assert Fraction(float(found[-1])) >= 1 + (samples - 1) * Fraction(1, 2**54)
