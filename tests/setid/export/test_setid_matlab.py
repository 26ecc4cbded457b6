"""The door for MATLAB and Octave, and files for its toolboxes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from identified_cases import first_order, identified

import setid
import sparsepop_py as sp
from setid.matlab import identify_structs
from sparsepop_py.compat import matlab_server
from sparsepop_py.errors import FormatError

U, Y = [4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875]


def asked(path: Path, *arguments: Any, task: str = "setid.matlab:identify_structs") -> Any:
    given = np.empty((1, len(arguments)), dtype=object)
    for place, argument in enumerate(arguments):
        given[0, place] = argument
    content = {"task": task, "arguments": given, "folder": str(path.parent)}
    scipy.io.savemat(path, content)
    matlab_server.answer(path)
    return scipy.io.loadmat(path, simplify_cells=True)


def test_structs_go_in_and_out_through_the_door(tmp_path: Path) -> None:
    answer = asked(
        tmp_path / "question.mat",
        np.array(U)[:, None],
        np.array(Y)[None, :],
        1.0,
        1.0,
        1.0,
        0.0,
        {"equation": 0.5},
        {"stable": 1.0, "timeLimit": 20.0},
    )
    assert not len(answer["error"])
    found = answer["outputs"]
    found = found if isinstance(found, dict) else found[0]
    assert list(found["names"]) == ["a1", "b0"] and list(found["status"]) == ["certified"] * 2
    # half planes meet at a1 = -0.5232558 and -0.3453333, b0 = 1.9166667 and 2.1093023
    expected = [[-0.5232558, -0.3453333], [1.9166667, 2.1093023]]
    assert found["outer"] == pytest.approx(np.array(expected), abs=2e-7)
    assert found["verified"] and "certified" in found["table"]
    assert np.all(found["best"] >= found["outer"][:, 0])


def test_wrong_input_comes_back_as_a_text(tmp_path: Path) -> None:
    path = tmp_path / "question.mat"
    answer = asked(path, U, Y, 1.0, 1.0, 1.0, 0.0, {"sensor": 0.5})
    assert "noise.sensor" in answer["error"]
    answer = asked(path, U, Y, 1.0, 1.5, 1.0, 0.0, 0.5)
    assert "na: found [[1.5]], expected integers" in answer["error"]
    answer = asked(path, U, Y, 1.0, 1.0, 1.0, 0.0, 0.5, {"stabel": 1.0})
    assert "options.stabel" in answer["error"]
    answer = asked(path, U, task="os:getcwd")
    assert "task: found 'os:getcwd'" in answer["error"]


@pytest.mark.parametrize(
    ("place", "value", "why"),
    [
        (0, "abc", "u: found text, expected numbers"),
        (2, [1.0, 2.0], "Ts: found 2 numbers, expected one"),
        (3, np.inf, "na: found [[inf]], expected integers"),
        (6, "x", "noise: found text, expected a struct"),
        (6, {"output": []}, "noise.output: found [], expected a bound"),
        (6, {"output": "x"}, "noise.output: found text, expected numbers"),
        (7, 3.0, "options: found a number, expected a struct"),
        (7, {"stable": "no"}, "options.stable: found text, expected numbers"),
        (7, {"timeLimit": "a"}, "options.timeLimit: found text, expected numbers"),
        (7, {"dcGain": [1.0, 3.0, 1.0]}, "options.dcGain: found 3 numbers"),
        (1, np.array(Y) + 1j, "y: found complex numbers"),
    ],
)
def test_values_of_a_wrong_kind_are_named(tmp_path: Path, place: int, value: Any, why: str) -> None:
    given: list[Any] = [np.array(U), np.array(Y), 1.0, 1.0, 1.0, 0.0, {"equation": 0.5}, {}]
    given[place] = value
    assert why in asked(tmp_path / "question.mat", *given)["error"]


def test_the_answer_has_the_script_of_the_uncertain_model(tmp_path: Path) -> None:
    (found,) = identify_structs(U, Y, 0.25, 1, 1, 0, {"equation": 0.5})
    data, model = setid.IOData(U, Y, 0.25), setid.TransferFunction(1, 1)
    result = setid.identify(data, model, setid.Noise(equation=0.5))
    assert found["ureal"] == setid.to_ureal(result, tmp_path / "m.m").read_text(encoding="utf-8")
    (none,) = identify_structs(U, Y, 0.25, 1, 1, 0, {"equation": 0.1})
    assert none["ureal"] == "" and "counts samples from 0" in none["summary"]


def test_several_channels_and_options() -> None:
    model = setid.TransferFunction([[1, 1]], [[1, 1]], 1, inputs=2, common_denominator=True)
    u = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    truth = setid.simulate_record(model, [-0.5, 1.0, 2.0], u, setid.Noise(equation=0.05))
    (found,) = identify_structs(
        u,
        truth.data.y,
        0.1,
        [[1, 1]],
        [[1, 1]],
        1,
        {"equation": 0.05},
        {"commonDenominator": 1, "inputNames": ["valve", "pump"], "dcGain": []},
    )
    direct = setid.identify(truth.data, model, setid.Noise(equation=0.05))
    ends = np.array([item.outer for item in direct.intervals.values()])
    assert np.array_equal(found["outer"], ends)
    assert "u1 = valve, u2 = pump" in found["table"]


def test_an_empty_set_has_no_members() -> None:
    (found,) = identify_structs(U, Y, 1, 1, 1, 0, {"equation": 0.1})
    assert [str(s) for s in found["status"].ravel()] == ["empty"] * 2
    assert np.all(np.isnan(found["best"])) and found["samples"].shape[1] == 2


def test_a_mat_file_of_the_uncertain_model(tmp_path: Path) -> None:
    result = first_order()
    found = scipy.io.loadmat(setid.to_mat(result, tmp_path / "model.mat"), simplify_cells=True)
    assert np.array_equal(found["outer"], [i.outer for i in result.intervals.values()])
    assert np.array_equal(found["members"], result.attained) and found["Ts"] == 1.0


@pytest.mark.parametrize("path", [None, -1, 0, 1.5, b"x", "", "a\0"])
def test_what_is_no_path_is_named(path: Any) -> None:
    for write in (setid.to_mat, setid.to_ureal):
        with pytest.raises(FormatError, match=f"path: found {re.escape(repr(path))}"):
            write(first_order(), path)


@pytest.mark.parametrize("write", [setid.to_mat, setid.to_ureal])
def test_a_folder_that_does_not_exist_is_named_before_the_search(
    write: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[Any] = []
    monkeypatch.setattr("setid.export.matlab_files.best", lambda *given: searched.append(given))
    with pytest.raises(sp.ProblemError, match="expected a file in a directory that exists"):
        write(first_order(), tmp_path / "nowhere" / "model.mat")
    assert not searched


def test_a_script_for_robust_control(tmp_path: Path) -> None:
    data = setid.IOData(U, Y, 0.25)
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    result = setid.identify(data, model, setid.Noise(equation=9.0), [setid.Box({"a1": (-1, 1)})])
    text = setid.to_ureal(result, tmp_path / "model.m").read_text(encoding="utf-8")
    pattern = r"(\w+) = ureal\('(\w+)', (\S+), 'Range', \[(\S+) (\S+)\]\);"
    found = {m[0]: tuple(map(float, m[2:])) for m in re.findall(pattern, text)}
    for name, (at, low, high) in found.items():
        assert (low, high) == result.intervals[name].outer and low <= at <= high
    assert set(found) == {"a1", "b1"} and text.endswith("G = tf([0 b1], [1 a1], 0.25);\n")


def test_a_script_names_what_is_not_in_its_model(tmp_path: Path) -> None:
    data = setid.IOData([1, 0, -1, 1, 2, 0], [0, 1.1, 0.2, -0.7, 1, 2.2])
    model = setid.TransferFunction(na=0, nb=1, nk=1, offset=True)
    result = setid.identify(data, model, setid.Noise(equation=0.5))
    text = setid.to_ureal(result, tmp_path / "model.m").read_text(encoding="utf-8")
    assert "\n% Left out of G: c.\n" in text and text.endswith("G = tf([0 b1], [1 0], 1);\n")
    without = setid.to_ureal(first_order(), tmp_path / "model.m").read_text(encoding="utf-8")
    assert "Left out" not in without


def test_scripts_of_several_channels_and_of_continuous_time(tmp_path: Path) -> None:
    model = setid.TransferFunction([[1, 1]], [[1, 1]], 0, inputs=2)
    u = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    priors = [setid.Box({name: (-1, 1) for name in model.parameters})]
    truth = setid.simulate_record(model, [0.5] * 4, u, setid.Noise(output=0.1))
    options = setid.Options(time_limit=1.0, progress=False)
    result = setid.identify(truth.data, model, setid.Noise(output=0.1), priors, options)
    text = setid.to_ureal(result, tmp_path / "two.m").read_text(encoding="utf-8")
    assert "G = [tf([b_1_1_0 0], [1 a_1_1_1], 1), tf([b_1_2_0 0], [1 a_1_2_1], 1)];" in text


def test_infinite_intervals_are_refused(tmp_path: Path) -> None:
    result = identified(first_order().formulation, [(-np.inf, 1.0), (0.0, 1.0)])
    with pytest.raises(setid.ModelError, match="finite interval"):
        setid.to_ureal(result, tmp_path / "model.m")
    with pytest.raises(sp.ProblemError, match="setidIdentify"):
        identify_structs(U, Y[:3], 1, 1, 1, 0, 0.5)
