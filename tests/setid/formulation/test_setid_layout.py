"""Names, places and printed equations; proved bounds of a small record."""

from __future__ import annotations

import numpy as np
import pytest

import setid
import sparsepop_py as sp


def mimo() -> setid.Formulation:
    u = [[1.0, 2.0], [3.0, -4.0], [5.0, 0.5]]
    y = [[0.0, 1.0], [0.25, 2.0], [1.0, -3.0]]
    model = setid.TransferFunction([[1, 1], [1, 0]], 1, [[1, 1], [1, 0]], 2, 2)
    return setid.formulate(setid.IOData(u, y), model, setid.Noise([0.1, 0.0], [0.0, 0.2]))


def test_groups_hold_every_variable_once() -> None:
    layout = mimo().layout
    numbers = np.concatenate([group[group >= 0] for group in layout.groups.values()])
    assert sorted(numbers.tolist()) == list(range(layout.dimension))
    assert all(layout.index(name) == place for place, name in enumerate(layout.names))
    assert layout.group("eta")[:, 1].tolist() == [-1, -1, -1]
    assert layout.names[layout.group("xi")[1, 1]] == "xi2[2]"
    assert layout.names[layout.group("z[1,2]")[0]] == "z[1,2][1]"
    with pytest.raises(setid.SetidError, match="group: found 'zeta'"):
        layout.group("zeta")


def test_equations_are_readable() -> None:
    formulation = mimo()
    lines = formulation.equation(2).splitlines()
    assert lines == [
        "z[1,1][2] + a[1,1]1*z[1,1][1] - b[1,1]1*(1) == 0",
        "z[1,2][2] + a[1,2]1*z[1,2][1] - b[1,2]1*(2 - xi2[1]) == 0",
        "(0.25 - eta1[2]) - z[1,1][2] - z[1,2][2] == 0",
        "z[2,1][2] + a[2,1]1*z[2,1][1] - b[2,1]1*(1) == 0",
        "z[2,2][2] - b[2,2]0*(-4 - xi2[2]) == 0",
        "(2) - z[2,1][2] - z[2,2][2] == 0",
    ]
    data = setid.IOData([1, 2, 3], [1.5, 2, 1])
    zero = setid.TransferFunction(1, 1, 1, offset=True, initial="zero")
    first = setid.formulate(data, zero, setid.Noise(equation=0.5)).equation(1)
    assert first == "-0.5 <= (1.5) + a1*0 - b1*0 - c <= 0.5"
    narx = setid.PolynomialNARX(["y1*u0"], 1, 0)
    text = setid.formulate(data, narx, setid.Noise(0.1, 0.1)).equation(3)
    assert text.splitlines() == [
        "p[y1*u0][3] - (2 - eta[2])*(3 - xi[3]) == 0",
        "(1 - eta[3]) - c[y1*u0]*p[y1*u0][3] == 0",
    ]


def test_constraints_know_their_sample() -> None:
    rows = mimo().rows
    assert set(rows.origin) == {"model"} and set(rows.record.tolist()) == {1}
    assert [rows.equation[r] for r in rows.of_sample(1)] == ["y1", "z[2,2]", "y2"]
    assert rows.sample.tolist() == sorted(rows.sample.tolist())


def test_regression_rows_know_their_place() -> None:
    data = setid.IOData([1, 2, 3, 1, 2], [1, 2, 1, 3, 1], starts=[0, 3])
    found = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(0.5)).regression
    assert found is not None
    assert found.row.tolist() == [1, 2, 4]
    assert found.record.tolist() == [1, 1, 2] and found.sample.tolist() == [2, 3, 2]
    assert found.target.tolist() == [2, 1, 1]
    assert found.regressors.tolist() == [[1, -2], [2, -3], [3, -2]]
    assert found.radius.tolist() == [0.5] * 3 and found.radii.tolist() == [[0.5, 0]] * 3


def test_proved_bounds_contain_the_truth() -> None:
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.1)
    u = np.random.default_rng(1).uniform(-1, 1, 8)
    truth = setid.simulate_record(model, [-0.5, 2.0], u, noise, seed=3)
    priors = [setid.Stable(), setid.Box({"b1": (-10, 10)})]
    formulation = setid.formulate(truth.data, model, noise, priors)
    for name, value in truth.theta.items():
        parameter = formulation.layout.variable(name)
        least = sp.solve(formulation.problem.with_objective(parameter))
        most = sp.solve(formulation.problem.with_objective(-parameter))
        assert least.lower_bound <= value <= -most.lower_bound
        assert least.lower_bound > value - 0.1 and -most.lower_bound < value + 0.1
        theta = least.x[formulation.layout.group("theta")]
        assert setid.least_noise(formulation, theta).level <= 1 + 1e-6
