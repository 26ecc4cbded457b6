"""Names and units of channels, columns of times, DataFrames."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import setid
from setid.data.times import sampling_time

EUROPEAN = "t;Ventil;Pegel\ns;V;mm\n0;1,5;0\n0,1;2;3,25\n0,2;-1;\n0,3;0;1e1\n"


def european(tmp_path: Path, text: str = EUROPEAN) -> Path:
    path = tmp_path / "record.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_decimal_commas_second_headers_and_times(tmp_path: Path) -> None:
    data = setid.IOData.from_csv(
        european(tmp_path), "Ventil", "Pegel", decimal=",", header=2, time="t"
    )
    assert data.Ts == 0.1 and data.time_unit == "s"
    assert data.u.ravel().tolist() == [1.5, 2.0, -1.0, 0.0]
    assert np.array_equal(data.y.ravel(), [0.0, 3.25, np.nan, 10.0], equal_nan=True)
    assert data.input_labels == ("Ventil [V]",) and data.output_labels == ("Pegel [mm]",)
    assert "Ts = 0.1 s" in repr(data)


def test_names_follow_the_channels_through_parts(tmp_path: Path) -> None:
    data = setid.IOData(
        np.arange(8.0).reshape(4, 2),
        [1, 2, 3, 5],
        input_names=["valve", "pump"],
        input_units=["V", ""],
        output_names="level",
        time_unit="min",
    )
    for part in (*data.split(2), data.decimate(2), data.detrend(), setid.IOData.concat([data] * 2)):
        assert part.input_labels == ("valve [V]", "pump") and part.output_labels == ("level",)
        assert part.time_unit == "min"
    other = setid.IOData(data.u[:, ::-1], data.y, input_names=["pump", "valve"])
    with pytest.raises(setid.DataError, match=r"records\[1\]\.input_names"):
        setid.IOData.concat([data, other])


def test_names_stand_on_tables_and_axes() -> None:
    pytest.importorskip("matplotlib").use("Agg")
    data = setid.IOData(
        [4, -3, 2, 1],
        [0, -6.25, 1.175, 2.0875],
        input_names="valve",
        output_names="level",
        output_units="m",
        time_unit="s",
    )
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    assert "y1 = level [m], u1 = valve" in result.table()
    drawn = data.plot()
    assert [ax.get_ylabel() for ax in drawn] == ["level [m]", "valve"]
    assert drawn[-1].get_xlabel() == "time [s]"
    assert result.predict().plot()[0].get_ylabel() == "level [m]"
    plain = setid.IOData(data.u, data.y)
    result = setid.identify(plain, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    assert "level" not in result.table() and "y1 =" not in result.table()


@pytest.mark.parametrize(
    ("names", "why"),
    [(["a", "a"], "distinct"), (["a"], "2, one a channel"), (3, "2, one a channel")],
)
def test_names_that_do_not_fit_are_refused(names: object, why: str) -> None:
    with pytest.raises(setid.DataError, match=f"input_names.*{why}"):
        setid.IOData(np.eye(2), [1, 2], input_names=names)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "field", ["input_names", "output_names", "input_units", "output_units", "time_unit"]
)
def test_halves_of_surrogate_pairs_are_refused(field: str) -> None:
    """No file holds them: they raised where a table or a picture was written."""
    with pytest.raises(setid.DataError, match=rf"{field}: found '\\ud83d', expected a text"):
        setid.IOData([1, 2], [1, 3], **{field: "\ud83d"})  # type: ignore[arg-type]
    whole = setid.IOData([1, 2], [1, 3], **{field: "\U0001f600"})  # type: ignore[arg-type]
    assert "\U0001f600" in getattr(whole, field)


def test_jitter_is_reported_and_gaps_are_refused() -> None:
    # 0.31 is 0.01 off the third multiple of 0.1: 10 % of the sampling time
    step, notes = sampling_time(np.array([0.0, 0.1, 0.2, 0.31, 0.4]), 0.1, "clock")
    assert step == 0.1 and "0.01 (10 % of Ts)" in notes[0]
    with pytest.raises(setid.DataError, match="interval of 0.2 between samples 1 and 2"):
        sampling_time(np.array([0.0, 0.1, 0.3, 0.4, 0.5]), 0.1, "clock")
    with pytest.raises(setid.DataError, match="interval of 0 between samples 0 and 1"):
        sampling_time(np.array([0.0, 0.0, 0.1, 0.2, 0.3]), None, "clock")
    with pytest.raises(setid.DataError, match="expected Ts = 0.2"):
        sampling_time(np.array([0.0, 0.1, 0.2]), 0.2, "clock")
    with pytest.raises(setid.DataError, match="no time at sample 1"):
        sampling_time(np.array([0.0, np.nan, 0.2]), None, "clock")
    with pytest.raises(setid.DataError, match="increasing"):
        sampling_time(np.array([0.2, 0.1, 0.0]), None, "clock")


def test_times_that_drift_are_refused_and_a_slow_clock_is_not() -> None:
    """k (1 + .0004 k) lies .0004 k (999 - k) from the line through its ends, most at 499, 500."""
    k = np.arange(1000.0)
    with pytest.raises(setid.DataError, match=r"found sample (499|500) 71 intervals from"):
        sampling_time(k * (1 + 4e-4 * k), None, "t")
    step, notes = sampling_time(k * (1 + 1e-6 * k), None, "t")  # .25 intervals at most
    assert abs(step - 1.000999) < 1e-9 and len(notes) == 1
    with pytest.raises(setid.DataError, match="intervals from equidistant times"):
        sampling_time(k * (1 + 2.2e-6 * k), None, "t")  # .55 intervals
    step, _ = sampling_time(1.003 * k, 1.0, "t")  # equidistant, only not quite at 1.0
    assert step == 1.0


def test_times_of_a_table_that_lost_a_row_are_refused(tmp_path: Path) -> None:
    lost = european(tmp_path, EUROPEAN.replace("0,2;-1;\n", ""))
    with pytest.raises(setid.DataError, match=r"record\.csv, column 't': found an interval"):
        setid.IOData.from_csv(lost, "Ventil", "Pegel", decimal=",", header=2, time="t")


def test_records_from_frames() -> None:
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame(
        {
            "when": pd.date_range("2020-01-01", periods=4, freq="500ms"),
            "valve": pd.array([1, 2, None, 4], dtype="Int64"),
            "level": [0.5, np.nan, 1.0, 2.0],
            "word": list("abcd"),
        }
    )
    data = setid.IOData.from_frame(frame, "valve", "level", time="when", time_unit="s")
    assert data.Ts == 0.5 and data.input_names == ("valve",) and data.output_names == ("level",)
    assert np.array_equal(data.u.ravel(), [1, 2, np.nan, 4], equal_nan=True)
    indexed = setid.IOData.from_frame(frame.set_index("when"), "valve", "level", time="when")
    assert indexed.Ts == 0.5 and indexed.time_unit == "s"
    local = frame.assign(when=frame.when.dt.tz_localize("Europe/Rome"))
    assert setid.IOData.from_frame(local, "valve", "level", time="when").Ts == 0.5
    spans = frame.assign(when=frame.when - frame.when[0])
    assert setid.IOData.from_frame(spans, "valve", "level", time="when").Ts == 0.5
    bare = frame.set_index("when").rename_axis(None)
    assert setid.IOData.from_frame(bare, "valve", "level", time="index").Ts == 0.5
    with pytest.raises(setid.DataError, match="u, y: found two indices that differ"):
        setid.IOData(frame["level"].iloc[:2], frame["level"].iloc[2:])
    lost = frame.assign(when=frame.when.mask(frame.index == 1))
    with pytest.raises(setid.DataError, match="no time at sample 1"):
        setid.IOData.from_frame(lost, "valve", "level", time="when")
    plain = setid.IOData(frame[["valve"]].astype(float), frame["level"], Ts=0.5)
    assert plain.input_names == ("valve",) and plain.output_names == ("level",)
    with pytest.raises(setid.DataError, match="'gauge'"):
        setid.IOData.from_frame(frame, "gauge", "level")
    with pytest.raises(setid.DataError, match="'word', sample 0: found 'a', expected a real"):
        setid.IOData.from_frame(frame, "word", "level")
    with pytest.raises(setid.DataError, match="DataFrame"):
        setid.IOData.from_frame([1, 2], "valve", "level")


def test_a_second_line_of_names_in_a_csv_file_of_pandas_holds_units() -> None:
    pd = pytest.importorskip("pandas")
    text = EUROPEAN.replace("s;V;mm", "s;[V];mm")
    frame = pd.read_csv(io.StringIO(text), sep=";", decimal=",", header=[0, 1])
    data = setid.IOData.from_frame(frame, "Ventil", "Pegel", time="t")
    assert data.input_labels == ("Ventil [V]",) and data.output_labels == ("Pegel [mm]",)
    assert data.Ts == 0.1 and data.time_unit == "s"


def test_intervals_as_a_frame() -> None:
    """The record of four samples whose ends are rationals by hand."""
    pytest.importorskip("pandas")
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model = setid.TransferFunction(na=1, nb=1)
    frame = setid.identify(data, model, setid.Noise(equation=0.5)).to_frame()
    assert list(frame.index) == ["a1", "b0"] and frame.index.name == "parameter"
    assert frame.outer_low["b0"] == pytest.approx(5.75 / 3, rel=1e-12)
    assert list(frame.status) == ["certified", "certified"]
    empty = setid.identify(data, model, setid.Noise(equation=0.01)).to_frame()
    assert list(empty.status) == ["empty", "empty"] and empty.inner_low.isna().all()


class Columns(dict[object, object]):
    """A table with columns by name, as others than pandas have them."""

    @property
    def columns(self) -> list[object]:
        return list(self)


def test_records_from_any_table_with_columns_by_name() -> None:
    table = Columns(
        t=np.array(["2020-01-01T00:00:00", "2020-01-01T00:00:02", "2020-01-01T00:00:04"], "M8[s]"),
        u=np.array([None, 3.0, 1.0], object),
        y=np.array([1, 2, 1]),
        flag=np.array([True, False, True]),
        text=np.array([1.0, "x", 2.0], object),
    )
    data = setid.IOData.from_frame(table, "u", "y", time="t")
    assert data.Ts == 2.0 and data.input_names == ("u",)
    assert np.array_equal(data.u.ravel(), [np.nan, 3.0, 1.0], equal_nan=True)
    masked = Columns(t=np.arange(3.0), u=np.ma.array([1, 9, 3], mask=[0, 1, 0]), y=np.arange(3.0))
    masked["day"] = np.ma.array(table["t"], mask=[0, 1, 0])
    u = setid.IOData.from_frame(masked, "u", "y").u.ravel()
    assert np.array_equal(u, [1.0, np.nan, 3.0], equal_nan=True)
    with pytest.raises(setid.DataError, match="found no time at sample 1"):
        setid.IOData.from_frame(masked, "u", "y", time="day")
    with pytest.raises(setid.DataError, match="'flag', sample 0: found .*True.*a real number$"):
        setid.IOData.from_frame(table, "flag", "y")
    with pytest.raises(setid.DataError, match="'text', sample 1: found 'x', expected a real"):
        setid.IOData.from_frame(table, "text", "y")


def test_names_of_tables_are_those_of_channels_and_second_names_are_units() -> None:
    table = Columns(
        {
            ("t", "min"): np.array([0, 60, 120], "m8[s]"),
            ("u", "[V]"): np.array([1.0, 3.0, 1.0]),
            ("y", ""): np.array([1.0, 2.0, 1.0]),
        }
    )
    data = setid.IOData.from_frame(table, "u", "y", time="t")
    assert data.Ts == 60.0 and data.time_unit == "s"  # spans of time count in seconds
    assert data.input_labels == ("u [V]",) and data.output_labels == ("y",)
    with pytest.raises(setid.DataError, match="column 'u' for two signals"):
        setid.IOData.from_frame(table, "u", "y", time="u")


@pytest.mark.parametrize(
    ("lines", "hint"),
    [
        ("s;V;mm\n0;1.5;0\n", r"found 'V', expected a number; if this .* \(--header 2\)$"),
        ("0;1,5;0\n", r"found '1,5', expected a number; if that .*=',' \(--decimal ,\)$"),
        ("0;1.5;0\n1;x;0\n", "found 'x', expected a number$"),
        ("0;x;0\n", "found 'x', expected a number$"),
    ],
)
def test_messages_say_what_to_tell(tmp_path: Path, lines: str, hint: str) -> None:
    with pytest.raises(setid.DataError, match=hint):
        setid.IOData.from_csv(european(tmp_path, "t;u;y\n" + lines), "u", "y")


@pytest.mark.parametrize("decimal", [".", ","])
def test_dates_of_a_table_count_in_seconds(decimal: str, tmp_path: Path) -> None:
    path = tmp_path / "dated.csv"
    moments = ("2026-02-28T23:59:59.75", "2026-03-01 00:00:00.250000", "2026-03-01T00:00:00.75", "")
    lines = [f"{moment};{k % 3};{k}" for k, moment in enumerate(moments)]
    path.write_text("\n".join(["when;valve;level", *lines[:3]]))
    data = setid.IOData.from_csv(path, "valve", "level", decimal=decimal, time="when")
    assert data.Ts == 0.5 and data.assumptions == ()
    path.write_text("\n".join(["when;valve;level", *lines]))
    with pytest.raises(setid.DataError, match="no time at sample 3"):
        setid.IOData.from_csv(path, "valve", "level", decimal=decimal, time="when")
    path.write_text("\n".join(["when;valve;level", *lines[:2], "2026-03-01T00:00:00.75Z;1;2"]))
    with pytest.raises(setid.DataError, match=r"line 4, column 0: .* all with a time zone"):
        setid.IOData.from_csv(path, "valve", "level", decimal=decimal, time="when")
    path.write_text("\n".join(["when;valve;level", *lines[:2], "2026-02-30T00:00:00;1;2"]))
    with pytest.raises(setid.DataError, match="line 4, column 0: .* expected a number"):
        setid.IOData.from_csv(path, "valve", "level", decimal=decimal, time="when")
