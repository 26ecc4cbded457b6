"""Boxes of theta from rows in its monomials, with sums that the engine bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from benchmarks.problems.block_structured import KINDS, record
from setid.feasible_set.start import find_box
from setid.formulation.regression import Regression
from setid.formulation.units import coupled_rows
from setid.proofs.parameter_box import box_follows, product_rows
from sparsepop_py.uncertain_rows.lifted_products import lifted_box
from sparsepop_py.verified.uncertain_rows.lifted_products import (
    LiftedBox,
    joined_equations,
)
from sparsepop_py.verified.uncertain_rows.products import contracted


def test_sums_over_shared_samples_bound_slow_poles() -> None:
    """Row by row 1 + a1 + a2 may be zero, and static gain 1 leaves all else without bounds."""
    truth, noise = record("hammerstein 2", 20, 5.0)
    model, theta, _ = KINDS["hammerstein 2"]
    formulation = setid.formulate(truth.data, model, noise)
    box = find_box(formulation)
    assert isinstance(box, LiftedBox) and box.sharper
    assert np.all(np.isfinite([box.lower, box.upper]))
    assert np.all((box.lower <= theta) & (box.upper >= theta))
    assert box_follows(box, formulation)
    without = replace(box, sharper=())
    assert not box_follows(without, formulation)  # it does not follow from the rows alone
    first = box.sharper[0]
    assert first is not None
    forged = (replace(first, bound=first.bound + 0.1), *box.sharper[1:])
    assert not box_follows(replace(box, sharper=forged), formulation)
    narrower = replace(box, lower=box.lower + 1e-3 * (box.upper - box.lower))
    assert not box_follows(narrower, formulation)


def two_denominators(samples: int, common: bool = False, form: str = "auto") -> tuple:
    """y = z1 + z2 + eta with a first-order recursion for each input; the truth behind it."""
    block = setid.TransferFunction(1, 1, 1)
    model = setid.BlockStructured(
        {("y1", "u1"): block, ("y1", "u2"): block}, {}, inputs=2, form=form
    )
    theta = np.array([-0.5, 0.6, 0.8, 0.3])  # a and a' first, then b and b'
    source = np.random.default_rng(5)
    u = source.uniform(-1.0, 1.0, (samples, 2))
    u[:, 1] = u[:, 0] if common else u[:, 1]
    noise = setid.Noise(output=0.02)
    return setid.simulate_record(model, theta, u, noise, source), model, theta, noise


def test_products_of_one_signal_are_one_column() -> None:
    """(1 + a q^-1)(1 + a' q^-1) y: a and a' both multiply y(k-1), and only their sum is seen."""
    truth, model, theta, noise = two_denominators(30)
    rows = product_rows(setid.formulate(truth.data, model, noise, [setid.Stable()]))
    assert rows is not None
    first, second = (model.parameters.index(f"a[y1,u{i}]1") for i in (1, 2))
    assert ((first,), (second,)) in rows.columns
    assert ((first, second),) in rows.columns  # a a' is alone at y(k-2)
    values = [sum(np.prod([theta[i] for i in m]) for m in column) for column in rows.columns]
    assert np.all(rows.regression.margin(np.array(values)) >= -1e-12)


def test_signals_that_happen_to_be_equal_are_not_joined() -> None:
    truth, model, _, noise = two_denominators(30, common=True)
    rows = product_rows(setid.formulate(truth.data, model, noise, [setid.Stable()]))
    assert rows is not None
    numerators = [model.parameters.index(f"b[y1,u{i}]1") for i in (1, 2)]
    assert all(((number,),) in rows.columns for number in numerators)


def test_a_sum_is_no_unknown_of_rows_that_multiply_its_parts_by_different_signals() -> None:
    """z1(k) + a z1(k-1) = b u1(k-1), likewise a' and z2: a + a' alone says nothing there."""
    for form, joins in (("direct", True), ("partial", False)):
        truth, model, _, noise = two_denominators(30, form=form)
        ranges = setid.Box({name: (-1.0, 1.0) for name in model.parameters})
        known = setid.formulate(truth.data, model, noise, [ranges])
        p, problem = len(model.parameters), known.problem
        internal = np.isinf(problem.lower[p:])
        bounded = sp.Problem(
            problem.objective,
            problem.constraints,
            np.append(problem.lower[:p], np.where(internal, -9.0, problem.lower[p:])),
            np.append(problem.upper[:p], np.where(internal, 9.0, problem.upper[p:])),
            problem.names,
        )
        rows = product_rows(known)
        assert rows is not None and internal.any() != joins
        found = lifted_box(rows, np.array([problem.lower[:p], problem.upper[:p]])).rounds[-1]
        stated = joined_equations(coupled_rows(replace(known, problem=bounded)), rows, found)
        assert (stated is not None) == joins


def test_a_sum_bounds_each_part_where_the_others_are_bounded() -> None:
    """x y + z in [1, 2] with x in [1, 2], z in [-1, 0] says y in [0.5, 3]."""
    box = np.array([[1.0, -np.inf, -1.0], [2.0, np.inf, 0.0]])
    found = contracted(box, {((0, 1), (2,)): (1.0, 2.0)}, ())
    assert np.allclose(found, [[1.0, 0.5, -1.0], [2.0, 3.0, 0.0]], rtol=0, atol=1e-12)
    assert found[0, 1] <= 0.5 and found[1, 1] >= 3.0


@pytest.mark.slow
def test_two_blocks_of_order_two_have_a_box_from_the_data() -> None:
    """Nine parameters, stable poles and nothing else given."""
    truth, noise = record("two inputs 2", 50)
    model, theta, priors = KINDS["two inputs 2"]
    formulation = setid.formulate(truth.data, model, noise, priors)
    box = find_box(formulation)
    assert isinstance(box, LiftedBox) and box_follows(box, formulation)
    assert np.all(np.isfinite([box.lower, box.upper]))
    assert np.all((box.lower <= theta) & (box.upper >= theta))


def test_rows_of_internal_signals_belong_to_no_output() -> None:
    """Two records of y = z + 0.3 z^2, z = -2 (u1 - u2): z is known, and has rows of its own."""
    u = np.array([[1.0, 0.0], [2.0, 1.0], [-1.0, 1.0], [0.0, 0.5], [1.5, 0.0], [-2.0, 1.0]])
    z = -2.0 * (u[:, 0] - u[:, 1])
    model = setid.BlockStructured(
        {("z", "u1 - u2"): setid.TransferFunction(0, 1, 0)},
        {"y1": setid.StaticMap("z", 2)},
        inputs=2,
        normalise={"b0": -2.0},
    )
    data = setid.IOData(u, z + 0.3 * z**2, starts=[0, 3])
    priors = [setid.Box({"gamma1": (0.0, 3.0), "gamma2": (-1.0, 1.0)})]
    formulation = setid.formulate(data, model, setid.Noise(output=0.01), priors)
    products = product_rows(formulation)
    assert products is not None and isinstance(products.regression, Regression)
    assert set(products.regression.output.tolist()) == {0, 1}
    box = find_box(formulation)
    assert box is not None and box_follows(box, formulation)
    assert np.all((box.lower <= [1.0, 0.3]) & (box.upper >= [1.0, 0.3]))
