"""Several records and missing samples: rows never cross a join, nothing is made up."""

from __future__ import annotations

import numpy as np
import pytest

import setid

NOISE = setid.Noise(output=0.3, input=0.1)
SECOND = setid.TransferFunction(2, 2, 1)
THETA = [-0.9, 0.2, 1.0, 0.5]


def simulated(samples: int, seed: int) -> setid.Simulated:
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    return setid.simulate_record(SECOND, THETA, u, NOISE, seed)


def test_rows_of_joined_records_are_those_of_each() -> None:
    parts = [simulated(7, 1), simulated(5, 2)]
    joined = setid.formulate(setid.IOData.concat([p.data for p in parts]), SECOND, NOISE)
    assert joined.layout.names[4:6] == ("eta[1,1]", "eta[1,2]")
    names, row = np.array(joined.layout.names), 0
    for record, part in enumerate(parts, 1):
        alone = setid.formulate(part.data, SECOND, NOISE)
        for constraint, sample in zip(alone.problem.constraints, alone.rows.sample, strict=True):
            other = joined.problem.constraints[row]
            assert other.polynomial.coefficients.tolist() == sorted_like(constraint, other)
            used = names[other.polynomial.support[4:]]
            assert all(name.split("[")[1].startswith(f"{record},") for name in used)
            assert (joined.rows.record[row], joined.rows.sample[row]) == (record, sample)
            row += 1
    assert row == len(joined.problem.constraints)
    output = np.concatenate([p.output for p in parts])
    input = np.concatenate([p.input for p in parts])
    assert joined.problem.violation(joined.point(THETA, output, input)) < 1e-12
    assert joined.equation(4, record=2).count("[2,") == 5
    with pytest.raises(setid.SetidError, match=r"k: found 2 \(record 2\)"):
        joined.equation(2, record=2)


def sorted_like(one, other) -> list[float]:
    """Coefficients of one constraint in the order of the other: both are graded."""
    assert one.polynomial.terms == other.polynomial.terms
    return one.polynomial.coefficients.tolist()


def test_zero_initial_state_holds_for_each_record() -> None:
    model = setid.TransferFunction(2, 2, 1, initial="zero")
    u = np.random.default_rng(3).uniform(-1, 1, 5)
    parts = [setid.simulate_record(model, THETA, u, NOISE, seed) for seed in (1, 2)]
    joined = setid.formulate(setid.IOData.concat([p.data for p in parts]), model, NOISE)
    assert joined.rows.sample.tolist() == [1, 2, 3, 4, 5] * 2
    x = joined.point(
        THETA,
        np.concatenate([p.output for p in parts]),
        np.concatenate([p.input for p in parts]),
    )
    assert joined.problem.violation(x) < 1e-12
    assert "all signals are zero before the record" in joined.assumptions


def test_rows_that_need_missing_samples_are_dropped_and_counted() -> None:
    truth = simulated(12, 4)
    y, u = truth.data.y.copy(), truth.data.u.copy()
    y[5], u[9] = np.nan, np.nan  # samples 6 and 10
    formulation = setid.formulate(setid.IOData(u, y), SECOND, NOISE)
    assert formulation.rows.sample.tolist() == [3, 4, 5, 9, 10]  # 6, 7, 8 and 11, 12 are gone
    assert formulation.dropped == 5
    assert "5 equations with missing samples are left out" in formulation.assumptions
    assert (
        formulation.problem.violation(formulation.point(THETA, truth.output, truth.input)) < 1e-12
    )
    assert "eta[6]" not in formulation.layout.names


def test_a_range_turns_missing_samples_into_unknowns() -> None:
    truth = simulated(12, 4)
    y, u = truth.data.y.copy(), truth.data.u.copy()
    y[5], u[9] = np.nan, np.nan
    data = setid.IOData(u, y, y_range=(-8, 8), u_range=(-1, 1))
    formulation = setid.formulate(data, SECOND, NOISE)
    assert formulation.dropped == 0
    assert formulation.rows.sample.tolist() == list(range(3, 13))
    names, problem = formulation.layout.names, formulation.problem
    box = dict(zip(names, zip(problem.lower, problem.upper, strict=True), strict=True))
    assert box["y[6]"] == (-8, 8) and box["u[10]"] == (-1, 1)
    assert "eta[6]" not in names and "xi[10]" not in names
    signals = {"y": truth.y, "u": truth.u}
    x = formulation.point(THETA, truth.output, truth.input, signals=signals)
    assert problem.violation(x) < 1e-12
    assert "y[6]" in formulation.equation(7) and "u[10]" in formulation.equation(11)
    assert formulation.regression is not None
    assert formulation.regression.margin(np.array(THETA)).min() > -1e-12
    assert any("missing samples of y lie in" in text for text in formulation.assumptions)
    assert formulation.point(THETA, truth.output, truth.input).shape == x.shape


def test_bounded_parameters_give_missing_outputs_a_range() -> None:
    """y(6) = -a1 y(5) - a2 y(4) + b1 u(5) + b2 u(4), each factor in a known interval."""
    truth = simulated(12, 4)
    y = truth.data.y.copy()
    y[5:7] = np.nan
    data = setid.IOData(truth.data.u, y)
    box = {name: (v - 0.1, v + 0.1) for name, v in zip(SECOND.parameters, THETA, strict=True)}
    formulation = setid.formulate(data, SECOND, NOISE, [setid.Box(box)])
    assert formulation.dropped == 0
    place = formulation.layout.index("y[6]")
    low, high = formulation.problem.lower[place], formulation.problem.upper[place]
    ends = [
        max(s * t for s in box[name] for t in (value - width, value + width))
        for name, value, width in (
            ("a1", -y[4, 0], 0.3),
            ("a2", -y[3, 0], 0.3),
            ("b1", data.u[4, 0], 0.1),
            ("b2", data.u[3, 0], 0.1),
        )
    ]
    assert high == pytest.approx(sum(ends)) and low < truth.y[5, 0] < high
    x = formulation.point(THETA, truth.output, truth.input, signals={"y": truth.y})
    assert formulation.problem.violation(x) < 1e-12
    later = formulation.layout.index("y[7]")
    assert formulation.problem.upper[later] - formulation.problem.lower[later] > high - low


def test_missing_samples_in_products_and_partial_outputs() -> None:
    narx = setid.PolynomialNARX(["y1", "y1*u1"], 1, 1)
    rng = np.random.default_rng(5)
    u, y = rng.uniform(size=8), rng.uniform(size=8)
    y[3] = np.nan
    formulation = setid.formulate(setid.IOData(u, y), narx, NOISE)
    samples = formulation.rows.sample[[e == "y1" for e in formulation.rows.equation]]
    assert samples.tolist() == [2, 3, 6, 7, 8]
    miso = setid.TransferFunction(1, 1, 1, inputs=2)
    two = setid.IOData(np.column_stack([u, rng.uniform(size=8)]), y)
    partial = setid.formulate(two, miso, NOISE)
    kept = partial.rows.sample[[e == "y1" for e in partial.rows.equation]]
    assert kept.tolist() == [1, 2, 3, 5, 6, 7, 8], "only the sum at sample 4 needs y(4)"


def test_records_without_a_complete_equation() -> None:
    short = setid.IOData([1, 2], [1, 2])
    with pytest.raises(setid.DataError, match="no complete equation, expected more than 2"):
        setid.formulate(short, SECOND, NOISE)
    gaps = setid.IOData([1, 2, 1, 2], [1, np.nan, np.nan, 2])
    expected = (
        "found 4 samples .* no complete equation, expected more than 1 in a row without missing"
    )
    with pytest.raises(setid.DataError, match=expected):
        setid.formulate(gaps, setid.TransferFunction(1, 1), NOISE)


def test_a_dead_input_is_warned_about() -> None:
    with pytest.warns(setid.SetidWarning, match="input 1 is zero throughout"):
        setid.formulate(setid.IOData([0, 0, 0], [1, 2, 1]), setid.TransferFunction(1, 1), NOISE)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((3, SECOND, NOISE), setid.DataError, "data: found int, expected IOData"),
        ((None, "tf", NOISE), setid.ModelError, "model: found str"),
        ((None, SECOND, 0.5), setid.NoiseError, "noise: found float, expected Noise"),
        (
            (None, setid.TransferFunction(1, 1, inputs=2), NOISE),
            setid.DataError,
            "found 1 inputs and 1 outputs, expected 2 and 1",
        ),
        ((None, SECOND, setid.Noise([0.1, 0.2])), setid.NoiseError, "output: found shape"),
    ],
)
def test_parts_that_do_not_fit(arguments, error, message: str) -> None:
    data, model, noise = arguments
    data = setid.IOData([1, 2, 3, 4], [1, 2, 2, 1]) if data is None else data
    with pytest.raises(error, match=message):
        setid.formulate(data, model, noise)


def test_points_are_checked() -> None:
    formulation = setid.formulate(simulated(6, 1).data, SECOND, NOISE)
    with pytest.raises(setid.SetidError, match=r"theta: found shape \(1,\), expected 4 numbers"):
        formulation.point([1.0])
    with pytest.raises(setid.SetidError, match="theta: found names"):
        formulation.point({"a1": 1.0})
    with pytest.raises(setid.SetidError, match=r"output: found shape \(2, 1\), expected \(6, 1\)"):
        formulation.point(THETA, output=[1, 2])
    by_name = dict(zip(SECOND.parameters, THETA, strict=True))
    assert np.array_equal(formulation.point(by_name), formulation.point(THETA))


def test_inputs_are_never_modified() -> None:
    u, y, bound = np.arange(6.0), np.arange(6.0) ** 2, np.full(6, 0.1)
    copies = u.copy(), y.copy(), bound.copy()
    data, noise = setid.IOData(u, y), setid.Noise(output=bound)
    formulation = setid.formulate(data, SECOND, noise, [setid.Stable()])
    setid.l1(data, SECOND)
    setid.least_noise(formulation, THETA)
    for now, before in zip((u, y, bound), copies, strict=True):
        assert np.array_equal(now, before)
        now[:] = 0.0
    assert np.array_equal(data.y[:, 0], copies[1])
    with pytest.raises(ValueError, match="read-only"):
        formulation.layout.group("theta")[0] = 1
