"""Boxes from the data alone: proved, never too small, refused when forged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification_cases import PLANT

import setid
from setid.proofs.parameter_box import product_rows
from sparsepop_py.uncertain_rows.lifted_products import lifted_box
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.sign_tree import LeftInverse, SignTree, linear_rows


def rows_of(samples: int, output: float, input: float, seed: int, claimed=None):
    u = np.random.default_rng(seed).uniform(0, 1, samples)
    model, noise = setid.TransferFunction(2, 3), setid.Noise(output=output, input=input)
    truth = setid.simulate_record(model, PLANT, u, noise, seed)
    return setid.formulate(truth.data, model, claimed or noise).regression


def brute_force(rows: setid.Regression, count: int, seed: int) -> np.ndarray:
    """Points that pass all rows, by random walks from the truth."""
    generator, points = np.random.default_rng(seed), [PLANT]
    for _ in range(count):
        start = points[generator.integers(len(points))]
        step = start + generator.normal(size=5) * [0.02, 0.02, 0.5, 0.5, 0.5]
        if np.all(rows.margin(step) >= 0):
            points.append(step)
    return np.array(points)


@pytest.mark.parametrize("output, input", [(1.0, 0.0), (1.0, 0.01), (5.0, 0.05)])
def test_everything_that_passes_the_rows_lies_in_the_box(output: float, input: float) -> None:
    rows = rows_of(40, output, input, 1)
    box = parameter_box(rows)
    points = brute_force(rows, 3000, 2)
    assert len(points) > 10
    assert np.all(points >= box.lower) and np.all(points <= box.upper)
    assert not box.empty and np.all(np.isfinite([box.lower, box.upper]))
    assert box.verify(rows, box.start)


def test_with_strong_noise_the_sign_tree_alone_still_bounds() -> None:
    rows = rows_of(20, 5.0, 0.05, 1)
    box = parameter_box(rows)
    assert all(isinstance(step, SignTree) for step in box.steps)
    assert np.all(box.lower <= PLANT) and np.all(box.upper >= PLANT)
    assert len(box.steps[0].leaves()) <= 32
    assert box.verify(rows, box.start)


def test_too_small_bounds_are_proved_empty_and_the_rows_are_named() -> None:
    rows = rows_of(60, 1.0, 0.0, 0, setid.Noise(output=0.1))
    box = parameter_box(rows)
    assert box.empty and repr(box) == "<ParameterBox: empty, proved>"
    assert box.verify(rows, box.start)
    used = box.used_rows(rows)
    assert used and all(0 <= row < rows.target.size for row in used) and min(used.values()) >= 1
    assert not box.verify(rows_of(60, 1.0, 0.0, 0), box.start)


def test_bounds_of_priors_start_the_box() -> None:
    rows = rows_of(20, 5.0, 0.05, 1)
    start = np.array([[-2.0, -1.0, -50, -50, -50], [2.0, 1.0, 50, 50, 50]])
    box = parameter_box(rows, start)
    assert np.all(box.lower >= start[0]) and np.all(box.upper <= start[1])
    assert np.all(box.lower <= PLANT) and np.all(box.upper >= PLANT)


def test_what_the_data_do_not_bound_stays_infinite() -> None:
    data = setid.IOData([1.0, 1.0, 1.0, 1.0, 1.1], [1.0, 1.0, 1.0, 1.0, 1.0])
    rows = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=2.0)).regression
    box = parameter_box(rows)
    assert np.all(np.isinf(box.lower)) and np.all(np.isinf(box.upper))


def test_forged_boxes_are_refused() -> None:
    rows = rows_of(40, 1.0, 0.01, 1)
    box = parameter_box(rows)
    first, *rest = box.steps
    assert isinstance(first, LeftInverse)
    smaller = replace(first, radius=0.5 * first.radius)
    assert not replace(box, steps=(smaller, *rest)).verify(rows, box.start)
    assert not replace(box, lower=box.lower + 1e-9).verify(rows, box.start)
    assert not replace(box, steps=()).verify(rows, box.start)
    assert not replace(first, inverse=first.inverse[:, :-1]).holds(rows)
    tree = rest[-1]
    while tree.children:
        tree = tree.children[0]
    strange = SignTree(0, (tree,), ())
    assert not replace(box, steps=(first, strange)).verify(rows, box.start)


def test_rows_on_a_box_hold_for_all_that_obey_the_rows() -> None:
    rows = rows_of(40, 1.0, 0.01, 1)
    points = brute_force(rows, 500, 3)
    low, high = points.min(axis=0) - 0.1, points.max(axis=0) + 0.1
    problem = linear_rows(rows, (low, high))
    for point in points:
        assert problem.violation(point) <= 1e-12
    flat = linear_rows(rows, (np.full(5, -np.inf), np.full(5, np.inf)))
    assert max(flat.violation(point) for point in points) <= 1e-12


def test_exact_regressors_make_one_linear_program() -> None:
    data = setid.IOData([4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875])
    model = setid.TransferFunction(1, 1)
    rows = setid.formulate(data, model, setid.Noise(equation=0.5)).regression
    box = parameter_box(rows)
    np.testing.assert_allclose(box.lower, [-0.5232558, 1.9166667], atol=1e-7)
    np.testing.assert_allclose(box.upper, [-0.3453333, 2.1093023], atol=1e-7)


def test_when_time_is_over_what_is_left_is_kept_as_it_is() -> None:
    rows = rows_of(20, 2.0, 0.05, 3)
    start = np.array([[-2.0, -2.0, -50.0, -50.0, -50.0], [2.0, 2.0, 50.0, 50.0, 50.0]])
    late = parameter_box(rows, start, until=0.0)
    assert late.cut_short and late.verify(rows, start)
    np.testing.assert_array_equal([late.lower, late.upper], start)
    whole = parameter_box(rows, start)
    assert not whole.cut_short
    forged = replace(late, lower=whole.lower, upper=whole.upper)
    assert not forged.verify(rows, start)


def test_products_of_parameters_keep_the_time_limit() -> None:
    """Two denominators multiplied out: what was proved until then holds, and says it is short."""
    model = setid.TransferFunction(2, 1, 1, inputs=2, form="direct")
    u = np.random.default_rng(3).uniform(-1, 1, (12, 2))
    theta = np.array([-0.5, 0.1, -0.4, 0.2, 1.0, 0.5])
    noise = setid.Noise(output=0.02)
    truth = setid.simulate_record(model, theta, u, noise, 1)
    rows = product_rows(setid.formulate(truth.data, model, noise))
    assert rows is not None
    start = np.array([np.full(6, -np.inf), np.full(6, np.inf)])
    late = lifted_box(rows, start, until=0.0)
    assert late.cut_short and len(late.rounds) == 1
    assert np.all(late.lower <= theta) and np.all(theta <= late.upper)
