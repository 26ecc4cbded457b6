"""Records: validation, files, parts, and that nothing given is ever modified."""

from __future__ import annotations

import copy
import pickle
from contextlib import suppress
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import scipy.io

import setid


def test_arrays_are_copied_and_read_only() -> None:
    u, y = np.array([1.0, 2.0, 4.0]), np.array([[1.0], [2.0], [3.0]])
    data = setid.IOData(u, y, Ts=0.5)
    u[0] = 9.0
    assert data.u[0, 0] == 1.0 and data.u.shape == (3, 1) == data.y.shape
    with pytest.raises(ValueError, match="read-only"):
        data.y[0] = 1.0
    assert data.time.tolist() == [0.0, 0.5, 1.0]
    assert (data.samples, data.inputs, data.outputs, data.records) == (3, 1, 1, 1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setid.IOData([1, 2], [1, 2, 3]), "u, y: found 2 and 3 samples"),
        (lambda: setid.IOData([1, np.inf], [1, 2]), r"u: found an infinite value at \[1\]"),
        (lambda: setid.IOData([1, 2], ["a", "b"]), "y: found list .*, expected real numbers"),
        (lambda: setid.IOData([1, 2], [1, 2j]), "y: found list .*, expected real numbers"),
        (lambda: setid.IOData([1, 2], np.ones((2, 1, 1))), r"y: found shape \(2, 1, 1\)"),
        (lambda: setid.IOData([], []), r"u: found shape \(0, 1\)"),
        (lambda: setid.IOData([1, 2], [np.nan, np.nan]), "y: found no number in channel 1"),
        (lambda: setid.IOData([1, 2], [1, 2], Ts=0), "Ts: found 0, expected a positive"),
        (lambda: setid.IOData([1, 2], [1, 2], Ts="fast"), "Ts: found 'fast', expected a number"),
        (lambda: setid.IOData([1, 2], [1, 2], starts=[1]), r"starts: found \[1\]"),
        (lambda: setid.IOData([1, 2], [1, 2], starts=[0, 2]), r"starts: found \[0, 2\]"),
        (lambda: setid.IOData([1, 2], [1, 2], y_range=(2, 1)), r"y_range: found \[2.0, 1.0\]"),
        (lambda: setid.IOData([1, 2], [1, 2]).split(2), "at: found 2, expected a row in 1..1"),
        (lambda: setid.IOData([1, 2], [1, 2]).split(1.5), "at: found 1.5"),
        (lambda: setid.IOData([1, 2], [1, 2]).decimate(0), "m: found 0, expected an integer >= 1"),
        (lambda: setid.IOData([1, 2], [1, 2]).detrend("cubic"), "kind: found 'cubic'"),
        (lambda: setid.IOData.concat([]), "records: found none"),
        (lambda: setid.IOData.concat([3]), r"records\[0\]: found int"),
    ],
)
def test_wrong_records(make, message: str) -> None:
    with pytest.raises(setid.DataError, match=message):
        make()


@pytest.mark.parametrize(
    "masked",
    [
        np.ma.array([0.0, 999.0, 2.0], mask=[0, 1, 0]),
        np.ma.array([0, 999, 2], mask=[0, 1, 0]),
        [np.ma.array([v], mask=[v == 999]) for v in (0, 999, 2)],
    ],
)
def test_masked_elements_are_missing_samples(masked: object) -> None:
    data = setid.IOData(masked, masked)
    expected = [0.0, np.nan, 2.0]
    assert np.array_equal(data.u.ravel(), expected, equal_nan=True)
    assert np.array_equal(data.y.ravel(), expected, equal_nan=True)


def test_what_is_proved_of_masked_samples_is_that_of_missing_ones() -> None:
    """The masked 999 is no reading; 1.175 in its place would be consistent."""
    y = np.ma.array([0.0, -6.25, 999.0, 2.0875], mask=[0, 0, 1, 0])
    data = setid.IOData(np.ma.array([4.0, -3.0, 2.0, 1.0]), y)
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    assert not result.empty
    online = setid.Recursive(setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    assert online.update(np.array([4.0, -3.0, 2.0, 1.0]), y)


def test_constant_inputs_warn_unless_zero() -> None:
    with pytest.warns(setid.SetidWarning, match="input 2 is constant"):
        setid.IOData([[1, 5], [2, 5]], [1, 2])
    setid.IOData([0, 0], [1, 2])


def test_rows_in_place_of_columns_are_warned_of() -> None:
    nine = np.arange(9.0)[None, :]
    with pytest.warns(setid.SetidWarning, match="found 1 samples of 9 inputs and 9 outputs"):
        setid.IOData(nine, nine)
    with pytest.warns(setid.SetidWarning, match="found 2 samples of 1 inputs and 3 outputs"):
        setid.IOData([1.0, 2.0], np.arange(6.0).reshape(2, 3))
    setid.IOData(nine.T, nine.T)
    setid.IOData(np.eye(2), np.eye(2))


def test_concat_keeps_beginnings_and_assumptions() -> None:
    one = setid.IOData([1, 2, 3], [1, 2, 3], Ts=0.1).detrend()
    two = setid.IOData([4, 5], [6, 7], Ts=0.1)
    three = setid.IOData.concat([setid.IOData.concat([one, two]), two])
    assert three.starts.tolist() == [0, 3, 5]
    assert three.record.tolist() == [0, 0, 0, 1, 1, 2, 2]
    assert three.first.tolist() == [0, 0, 0, 3, 3, 5, 5]
    assert three.assumptions == one.assumptions and len(one.assumptions) == 1
    with pytest.raises(setid.DataError, match=r"records\[1\].Ts: found 1.0, expected 0.1"):
        setid.IOData.concat([one, setid.IOData([1, 2], [1, 2])])
    with pytest.raises(setid.DataError, match=r"records\[1\].inputs: found 2, expected 1"):
        setid.IOData.concat([one, setid.IOData([[1, 2], [2, 3]], [1, 2], 0.1)])
    with pytest.raises(setid.DataError, match="y_range"):
        setid.IOData.concat([two, setid.IOData([4, 5], [6, 7], 0.1, y_range=(0, 9))])


def test_split_and_decimate_respect_records() -> None:
    u = np.arange(10.0) ** 2
    data = setid.IOData(u, u, Ts=2.0, starts=[0, 6])
    left, right = data.split(0.4)
    assert left.u.ravel().tolist() == u[:4].tolist() and left.starts.tolist() == [0]
    assert right.starts.tolist() == [0, 2] and right.samples == 6
    assert data.split(6)[1].starts.tolist() == [0]
    assert [data.split(share)[0].samples for share in (0.44, 0.46)] == [4, 5]  # the nearest rows
    thin = data.decimate(4)
    assert thin.u.ravel().tolist() == [0, 16, 36] and thin.starts.tolist() == [0, 2]
    assert thin.Ts == 8.0 and "decimated by 4" in thin.assumptions[0]
    assert data.decimate(1).assumptions == ()


def test_detrend_is_a_new_record_with_an_assumption() -> None:
    t = np.arange(6.0)
    data = setid.IOData(t**2, np.concatenate([3 + 2 * t[:5], [np.nan]]))
    flat = data.detrend("linear")
    np.testing.assert_allclose(flat.y[:5], 0, atol=1e-12)
    assert np.isnan(flat.y[5, 0]) and "linear" in flat.assumptions[0]
    np.testing.assert_allclose(data.detrend().u.mean(), 0, atol=1e-12)
    assert data.y[0, 0] == 3.0
    ends = setid.IOData([1, 2, 3, 7], [5, 7, 9, 4], starts=[0, 3]).detrend("linear")
    np.testing.assert_allclose(ends.y, 0, atol=1e-12)  # one sample has its mean as its trend
    np.testing.assert_allclose(ends.u, 0, atol=1e-12)


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_tables(tmp_path: Path, separator: str) -> None:
    lines = [["t", "in", "out"], ["0", "1.5", "2"], ["1", "-1e-3", "nan"], ["2", "0", "4"]]
    path = tmp_path / "record.csv"
    path.write_text("# measured\n" + "\n".join(separator.join(line) for line in lines) + "\n\n")
    data = setid.IOData.from_csv(path, "in", ["out", "t"], Ts=0.2)
    assert data.u.ravel().tolist() == [1.5, -1e-3, 0.0] and data.Ts == 0.2
    assert data.y[:, 1].tolist() == [0, 1, 2] and np.isnan(data.y[1, 0])
    by_number = setid.IOData.from_csv(path, 1, 2)
    assert np.array_equal(by_number.u, data.u)


def test_tables_without_names(tmp_path: Path) -> None:
    path = tmp_path / "bare.txt"
    path.write_text("1 2\n3 4\n5 9\n")
    assert setid.IOData.from_csv(path, 0, 1).y.ravel().tolist() == [2, 4, 9]
    with pytest.raises(setid.DataError, match="found no single column 'u', expected one of the"):
        setid.IOData.from_csv(path, "u", 1)


@pytest.mark.parametrize(
    ("text", "inputs", "message"),
    [
        ("u,y\n1,2\n3\n", "u", "line 3: found 1 fields, expected 2"),
        ("u,y\n1,2\n3,x\n", "u", "line 3, column 1: found 'x', expected a number"),
        ("u,y\n1,2\n", "v", r"found no single column 'v', expected one of \['u', 'y'\]"),
        ("u,u,y\n1,2,3\n", "u", "found no single column 'u'"),
        ("u,y\n1,2\n", 5, r"found column 5, expected 0..1"),
        ("\n# nothing\n", "u", "found no lines"),
    ],
)
def test_wrong_tables(tmp_path: Path, text: str, inputs: object, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(setid.DataError, match=message):
        setid.IOData.from_csv(path, inputs, "y")


def test_matlab_files(tmp_path: Path) -> None:
    path = tmp_path / "record.mat"
    values = {"u1": np.array([[1.0, 2.0, 5.0]]), "u2": np.array([[4.0], [2.0], [5.0]]),
              "y": np.arange(6.0).reshape(2, 3), "name": "rig"}  # fmt: skip
    scipy.io.savemat(path, values)
    data = setid.IOData.from_mat(path, u=["u1", "u2"], Ts=0.1)
    assert data.u.tolist() == [[1, 4], [2, 2], [5, 5]]
    assert data.y.tolist() == [[0, 3], [1, 4], [2, 5]]
    pump = setid.IOData.from_mat(path, u="u2")
    assert (pump.input_names, pump.output_names) == (("u2",), ("y1", "y2"))
    short = setid.IOData.from_mat(path.with_suffix(""), u=["u1", "u2"], Ts=0.1)
    np.testing.assert_array_equal(short.u, data.u)  # as in MATLAB, the suffix may be left out
    with pytest.raises(setid.DataError, match="No such file"):
        setid.IOData.from_mat(tmp_path / "nowhere.mat")
    with pytest.raises(setid.DataError, match="found no variable 'x', expected one of"):
        setid.IOData.from_mat(path, u="x")
    with pytest.raises(setid.DataError, match="name: found ndarray"):
        setid.IOData.from_mat(path, u="name")
    newer = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"  # its header
    (tmp_path / "new.mat").write_bytes(newer.ljust(512, b"\0"))
    with pytest.raises(setid.DataError, match="found a MATLAB 7.3 file, .*-v7"):
        setid.IOData.from_mat(tmp_path / "new.mat")
    (tmp_path / "nothing.mat").write_bytes(b"")
    with pytest.raises(setid.DataError, match="expected a MATLAB file"):
        setid.IOData.from_mat(tmp_path / "nothing.mat")
    damaged = bytearray(path.read_bytes())
    for place in range(128, min(len(damaged), 400)):  # byte 176 ended the process
        changed = damaged[:place] + bytes([251]) + damaged[place + 1 :]
        (tmp_path / "damaged.mat").write_bytes(changed)
        with suppress(setid.DataError):
            setid.IOData.from_mat(tmp_path / "damaged.mat")
    (tmp_path / "no.mat").write_text("not a MATLAB file at all, but long enough to be read" * 9)
    with pytest.raises(setid.DataError, match="expected a MATLAB file"):
        setid.IOData.from_mat(tmp_path / "no.mat")


def test_times_of_matlab_files_are_checked_as_those_of_tables(tmp_path: Path) -> None:
    path = tmp_path / "rig.mat"
    t = 5.0 + 0.02 * np.arange(6)
    values = {"u": np.arange(6.0), "y": np.ones((6, 2)), "t": t, "late": t.copy(), "short": t[:4]}
    values["late"][3:] += 0.02  # a sample is missing
    values["near"] = t + np.where(np.arange(6) == 2, 0.002, 0.0)
    scipy.io.savemat(path, values)
    data = setid.IOData.from_mat(path, time="t", time_unit="s")
    assert (data.Ts, data.time_unit, data.assumptions) == (0.02, "s", ())
    assert setid.IOData.from_mat(path, Ts=0.02, time="t").Ts == 0.02
    assert setid.IOData.from_mat(path).Ts == 1.0
    (note,) = setid.IOData.from_mat(path, Ts=0.02, time="near").assumptions
    assert "10 % of Ts" in note and f"{path}, near" in note
    for name, Ts, message in (
        ("late", None, "late: found an interval of 0.04 between samples 2 and 3"),
        ("t", 0.1, "t: found intervals of 0.02 on average, expected Ts = 0.1"),
        ("short", None, r"found \[4, 6\] samples, expected equal numbers"),
        ("y", None, "found column 'y' for two signals"),
        ("when", None, "found no variable 'when'"),
    ):
        with pytest.raises(setid.DataError, match=message):
            setid.IOData.from_mat(path, time=name, Ts=Ts)
    with pytest.raises(setid.DataError, match="y: found 2 columns, expected one time for each"):
        setid.IOData.from_mat(path, u="u", y="t", time="y")


def test_pictures() -> None:
    data = setid.IOData(np.arange(8).reshape(4, 2), [1, np.nan, 2, 3], starts=[0, 2])
    axes = data.plot()
    assert [axis.get_ylabel() for axis in axes] == ["y1", "u1", "u2"]
    assert len(axes[0].lines) == 2
    plt.close("all")


def test_copies_of_records_are_read_only_too() -> None:
    data = setid.IOData([1, 2, 3], [4, 5, np.nan], 0.1, y_range=(0, 9), time_unit="s")
    for other in (copy.copy(data), copy.deepcopy(data), pickle.loads(pickle.dumps(data))):
        assert repr(other) == repr(data) and np.array_equal(other.y, data.y, equal_nan=True)
        for array in (other.u, other.y, other.starts, other.y_range):
            assert not array.flags.writeable


def test_printing() -> None:
    data = setid.IOData([1, np.nan, 3], [[1, 2], [2, 3], [1, np.nan]], Ts=0.1, starts=[0, 1])
    expected = "<IOData: 3 samples, 1 input, 2 outputs, Ts = 0.1, 2 records, 2 missing>"
    assert repr(data) == expected


def test_paths_and_columns_of_other_types_are_named(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("u,y\n1,2\n2,3\n")
    with pytest.raises(setid.DataError, match="path: found None"):
        setid.IOData.from_csv(None, "u", "y")  # type: ignore[arg-type]
    for column in (1.5, None):
        with pytest.raises(setid.DataError, match="columns: found"):
            setid.IOData.from_csv(path, column, "y")  # type: ignore[arg-type]


def test_other_outputs_have_the_same_shape_and_are_frozen() -> None:
    data = setid.IOData([1.0, 2.0], [3.0, 4.0], Ts=0.5, output_names=["level"])
    given = np.array([[5.0], [np.nan]])
    other = data.with_outputs(given)
    given[0] = 9.0
    assert other.y[0, 0] == 5.0 and data.y.ravel().tolist() == [3.0, 4.0]
    assert (other.Ts, other.output_names) == (0.5, ("level",)) and not other.y.flags.writeable
    for wrong in ([1.0, 2.0, 3.0], [[1.0, 2.0]], [np.inf, 1.0], ["a", "b"]):
        with pytest.raises(setid.DataError):
            data.with_outputs(wrong)
