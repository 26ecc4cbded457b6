"""Evidence with a lie in one field: each is refused, and the honest one beside it is not."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import setid
from setid.formulation.completion import affine
from setid.proofs.cells.output_cells import CellBox, cell_box
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.existence import admitted, rows_say_all
from setid.proofs.least_noise.least_error import OutputErrors, stated, verify_output
from setid.proofs.parameter_box import ParameterBox, box_follows, problem_on_box, start_of
from setid.proofs.uniqueness.unbounded import Unbounded, moved_parameters, simpler_structures
from setid.result.json_parts import write
from sparsepop_py.io.json_files.certificates import CERTIFICATES
from sparsepop_py.uncertain_rows.sign_tree import parameter_box

ONE, TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 2, 1)


def first_order(samples: int = 20) -> setid.Formulation:
    noise = setid.Noise(output=0.02)
    u = np.random.default_rng(1).uniform(-1, 1, samples)
    truth = setid.simulate_record(ONE, [-0.6, 2.0], u, noise, 1)
    return setid.formulate(truth.data, ONE, noise)


# ---- boxes ------------------------------------------------------------------------------


def test_boxes_of_rows_are_checked() -> None:
    known = first_order()
    assert known.smoothed is not None
    box = parameter_box(known.smoothed, start_of(known))
    assert isinstance(box, ParameterBox) and box_follows(box, known)
    middle = box.lower / 2 + box.upper / 2
    assert not box_follows(replace(box, lower=middle), known)
    assert not box_follows(replace(box, upper=middle), known)


def test_boxes_of_cells_are_checked() -> None:
    random = np.random.default_rng(0)
    model = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="b1", initial="zero")
    u, z = random.uniform(-1.0, 1.0, 30), np.zeros(30)
    for k in range(1, 30):
        z[k] = 0.4 * z[k - 1] + u[k - 1]
    data, noise = setid.IOData(u, 0.8 * z + 0.3 * z**2), setid.Noise(output=1e-3)
    known = setid.formulate(data, model, noise, [setid.Stable()])
    box = cell_box(known, start_of(known))
    assert isinstance(box, CellBox) and box_follows(box, known)
    far = np.full(box.lower.size, 3.0)
    assert not box_follows(replace(box, lower=box.lower + far, upper=box.upper + far), known)


@pytest.mark.parametrize("shape", [(0, 2), (1, 2), (0,), (1,), (2, 1), (2, 2)])
def test_boxes_have_one_pair_of_ends_a_parameter(shape: tuple[int, ...]) -> None:
    """No end is above those of an empty array, and few are above those of a row."""
    known = first_order()
    assert known.smoothed is not None
    box = parameter_box(known.smoothed, start_of(known))
    low, high = np.full(shape, -9.0), np.full(shape, 9.0)
    assert box_follows(replace(box, lower=np.full(2, -9.0), upper=np.full(2, 9.0)), known)
    for other in (replace(box, lower=low), replace(box, upper=high)):
        assert not box_follows(other, known)
    first = ParameterBox(box.names, low, high, start_of(known), ())
    for within in (box.lower, np.array([0.2, 5.0])):
        nested = DenominatorBox(box.names, within, within + 1.0, first, (), ())
        assert not box_follows(nested, known)


def test_stored_boxes_without_ends_are_refused() -> None:
    """The first box claims nothing of nothing, so that any second one would follow."""
    u = np.random.default_rng(0).normal(size=40)
    y = np.array([sum(0.7 ** (k - 1 - i) * u[i] for i in range(k)) for k in range(40)])
    given = setid.IOData(u, y), ONE, setid.Noise(output=0.1)
    found = setid.identify(*given, options=setid.Options(progress=False))
    none, names = np.zeros((0, 2)), found.formulation.parameters
    first = ParameterBox(names, none, none, none, ())
    box = DenominatorBox(names, np.array([0.2, 5.0]), np.array([0.3, 6.0]), first, (), ())
    text = json.loads(found.to_json())
    problem = problem_on_box(found.formulation, box)
    none_of_them = CERTIFICATES.write([])
    text["result"] |= {
        "box": write(box),
        "fingerprint": problem.fingerprint,
        "ends": {"attained": [], "results": [], "certificates": none_of_them},
    }
    for place, item in enumerate(text["result"]["intervals"]):
        outer = [float(box.lower[place]), float(box.upper[place])]
        item |= {"outer": outer, "inner": None, "status": "PARTIAL", "witnesses": [None, None]}
    with pytest.raises(setid.SetidError, match="the box does not follow"):
        setid.Identification.from_json(json.dumps(text))


def test_the_problem_on_a_box_keeps_the_bounds_of_priors() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    prior = setid.Box({"a1": (-0.5, -0.25), "b0": (1.0, 3.0)})
    known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5), prior)
    box: Any = SimpleNamespace(lower=np.array([-1.0, 1.5]), upper=np.array([-0.375, 9.0]))
    problem = problem_on_box(known, box)
    assert problem.lower[:2].tolist() == [-0.5, 1.5] and problem.upper[:2].tolist() == [-0.375, 3.0]


# ---- parameters that are unbounded ------------------------------------------------------


def with_a_delay_less(noise: float) -> tuple[setid.Formulation, Unbounded]:
    """y = 1.5, -0.5, 1 for u = 1, -1, 1: y = u holds with noise of 0.5 in samples one and two."""
    data = setid.IOData([1.0, -1.0, 1.0], [1.5, -0.5, 1.0])
    known = setid.formulate(data, ONE, setid.Noise(output=noise))
    lower = setid.TransferFunction(0, 1, 0)
    part = setid.formulate(data.split(2)[0], lower, setid.Noise(output=noise))
    witness = part.point([1.0], output=np.array([[0.5], [0.5]]))
    return known, Unbounded(("a1", "b1"), lower, np.ones(1), witness)


def test_noise_at_its_bounds_proves_no_delay_less() -> None:
    """What a large c moves is made up for by noise with something to spare only."""
    known, claim = with_a_delay_less(0.625)
    assert claim.verify(known)
    known, claim = with_a_delay_less(0.5)
    assert not claim.verify(known)


def test_only_parameters_that_change_are_unbounded() -> None:
    known, claim = with_a_delay_less(0.625)
    for names in ((), ("a1",), ("b1", "a1"), ("a1", "b1", "b1")):
        assert not replace(claim, names=names).verify(known)
    assert not replace(claim, witness=claim.witness + 10.0).verify(known)


def test_zero_coefficients_stay_zero() -> None:
    """(1 + c q^-1) and 2 q^-1 (1 + c q^-1): a2 and b1 stay what they are."""
    data = setid.IOData([1.0, -1.0, 2.0, 1.0, 0.5], [0.0, 2.0, -2.0, 4.0, 2.0])
    known = setid.formulate(data, TWO, setid.Noise(output=0.1))
    assert [f.model for f in simpler_structures(known)][-1] == ONE
    assert moved_parameters(known, ONE, np.array([0.0, 2.0])) == ("a1", "b2")


# ---- points -----------------------------------------------------------------------------


def test_priors_are_asked_about_all_parameters_near_a_point() -> None:
    seen: list[dict[str, tuple[float, float]]] = []

    def admits(model: object, box: dict[str, tuple[float, float]]) -> bool:
        seen.append(box)
        return True

    prior = SimpleNamespace(admits=admits)
    known: Any = SimpleNamespace(parameters=("a", "b"), priors=[prior], model=None)
    random = np.random.default_rng(2)
    for centre, reach in random.uniform(0.1, 1.0, (100, 2, 2)):
        assert admitted(known, centre, reach)
        for (low, high), c, r in zip(seen.pop().values(), centre, reach, strict=True):
            middle, radius = Fraction(float(c)), Fraction(float(r))
            assert Fraction(low) <= middle - radius and middle + radius <= Fraction(high)
    assert admitted(known, [0.5, 0.25]) and seen.pop() == {"a": (0.5, 0.5), "b": (0.25, 0.25)}


def test_linearised_rows_are_the_rows_where_they_touch() -> None:
    """Products of parameters and noise: value and slopes of each row at a point, in rationals."""
    known = first_order(6)
    x = np.random.default_rng(3).integers(-4, 5, known.problem.dimension).astype(float)
    free = np.arange(x.size)
    found = affine(known, x, free)
    assert not found.exact
    values = known.problem.rows.values(x)
    assert np.allclose(found.matrix @ x + found.constant, values, rtol=0, atol=1e-12)
    step = 2.0**-20
    for i in free:
        moved = x.copy()
        moved[i] += step
        slope = (known.problem.rows.values(moved) - values) / step
        assert np.allclose(found.matrix.toarray()[:, i], slope, rtol=0, atol=1e-8)


# ---- least errors -----------------------------------------------------------------------


@pytest.mark.parametrize("norm", ["linf", "l2", "l1"])
def test_an_error_needs_a_point_that_attains_it(norm: Any) -> None:
    known = first_order(5)
    claim = OutputErrors(norm, 1.0, stated(known.data, ONE, (), 1.0), None, None, None)
    assert verify_output(claim, 0.0, np.inf)
    assert verify_output(claim, 0.0, 0.5).reason == "the error is not attained"


def test_records_of_least_errors_keep_their_priors() -> None:
    known, prior = first_order(5), setid.Box({"a1": (-0.5, 0.5)})
    again = stated(known.data, ONE, [prior], 1.0)
    assert again.priors == (prior,)
    assert again.problem.lower[0] == -0.5 and again.problem.upper[0] == 0.5


def test_rows_say_all_where_no_box_of_parameters_is_asked_about() -> None:
    """A prior that is proved of small parameters alone; jury's of order three, of some."""
    u, y = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 8))
    data, noise = setid.IOData(u, y), setid.Noise(output=0.5)
    known = setid.formulate(data, setid.TransferFunction(0, 1), noise)

    def admits(model: object, box: dict[str, tuple[float, float]]) -> bool:
        return all(-1.0 <= low <= high <= 1.0 for low, high in box.values())

    small: Any = replace(known, priors=(SimpleNamespace(admits=admits),))
    assert rows_say_all(known) and not rows_say_all(small)
    for order, form, says in ((3, "step-up", True), (3, "jury", False), (2, "jury", True)):
        model, priors = setid.TransferFunction(order, 1), [setid.Stable(form=form)]
        assert rows_say_all(setid.formulate(data, model, noise, priors)) == says
