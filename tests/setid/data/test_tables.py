"""Text tables: every line inside is a sample, a missing one, or an error that names it.

The record behind most tests is y(k) = .7 y(k-1) + .5 u(k) + e(k) with |e| <= .01, as published in
a report of a false guarantee: rows that vanished made their neighbours consecutive samples.
"""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import setid
from setid.data.tables import column_names, read_table

ERRORS = ("#N/A", "#DIV/0!", "#VALUE!", "#REF!", "#NUM!", "#NAME?", "#NULL!")


def written(folder: Path, text: str) -> Path:
    path = folder / "record.csv"
    path.write_text(text, encoding="utf-8")
    return path


def report(bad: str) -> str:
    """The published record, row 15 replaced."""
    generator = np.random.default_rng(0)
    u, e = generator.uniform(-1, 1, 30), generator.uniform(-0.01, 0.01, 30)
    y, rows = 0.0, []
    for k in range(30):
        y = 0.7 * y + 0.5 * u[k] + e[k]
        rows.append(f"{u[k]!r},{y!r}".replace("np.float64(", "").replace(")", ""))
    rows[15] = bad.replace("<y>", rows[15].split(",")[1])
    return "u,y\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize("marker", ERRORS)
def test_error_values_of_spreadsheets_are_missing_samples(tmp_path: Path, marker: str) -> None:
    data = setid.IOData.from_csv(written(tmp_path, report(f"{marker},<y>")), "u", "y")
    assert data.samples == 30
    assert np.isnan(data.u[15, 0]) and not np.isnan(data.y[15, 0])


def test_what_is_proved_of_the_published_record_holds_the_truth(tmp_path: Path) -> None:
    data = setid.IOData.from_csv(written(tmp_path, report("#N/A,<y>")), "u", "y")
    model, noise = setid.TransferFunction(na=1, nb=1, nk=0), setid.Noise(equation=0.011)
    found = {name: p.outer for name, p in setid.identify(data, model, noise).intervals.items()}
    gain = next(outer for name, outer in found.items() if name.startswith("b"))
    assert gain[0] <= 0.5 <= gain[1]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ("", "line 17: found an empty line between samples"),
        ("# pump off", "line 17: found 1 fields, expected 2"),
        ("% pump, off", "line 17, column 0: found '% pump', expected a number"),
        ("1_000,<y>", "line 17, column 0: found '1_000', expected a number"),
        ("\u0661,<y>", "line 17, column 0: found '\u0661', expected a number"),
        ("inf,<y>", "line 17, column 0: found 'inf', expected a number"),
        ("0x1p3,<y>", "line 17, column 0: found '0x1p3', expected a number"),
        ("1e999,<y>", "line 17, column 0: found '1e999', beyond all doubles"),
        ('"1,<y>', "line 17: unexpected end of data"),
        ("0,5,0,3", "line 17: found 4 fields, expected 2"),
    ],
)
def test_a_line_inside_the_table_never_vanishes(tmp_path: Path, bad: str, message: str) -> None:
    with pytest.raises(setid.DataError, match=message):
        setid.IOData.from_csv(written(tmp_path, report(bad)), "u", "y")


@given(st.lists(st.sampled_from(["1,2", "", "#x", "%", ",", "#N/A,3", "4,nan", "x,y"]), min_size=1))
def test_as_many_samples_as_lines_or_an_error(tmp_path_factory, rows: list[str]) -> None:
    path = written(tmp_path_factory.mktemp("tables"), "u,y\n0,0\n" + "\n".join(rows))
    while rows and not rows[-1]:
        rows = rows[:-1]  # blank lines at the end of a file end it
    try:
        found = read_table(path, [0, 1]).columns[0]
    except setid.DataError:
        assert {"", "#x", "%", "x,y"} & set(rows)
    else:
        assert found.size == 1 + len(rows)


def test_what_was_skipped_stands_in_the_assumptions(tmp_path: Path) -> None:
    text = "# rig 7\n\n% 2024\nvalve;level\nV;cm\n0,5;1,25\n1;2\n"
    path = written(tmp_path, text)
    data = setid.IOData.from_csv(path, "valve", "level", decimal=",", header=2)
    assert data.u.ravel().tolist() == [0.5, 1.0] and data.y.ravel().tolist() == [1.25, 2.0]
    assert [text.split(":")[1].strip()[:6] for text in data.assumptions] == [
        "line 1",
        "line 3",
        "line 5",
    ]


@pytest.mark.parametrize("first", ["1.0;0,7x", "u,1.5", "1.0,abc"])
def test_an_unreadable_first_sample_is_no_header(tmp_path: Path, first: str) -> None:
    path = written(tmp_path, first + "\n" + first.replace("x", "") + "\n")
    with pytest.raises(setid.DataError, match="line 1: found .* beside numbers"):
        setid.IOData.from_csv(path, 0, 1)


def test_a_first_sample_that_begins_like_a_comment_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "#N/A,0.3\n0.1,0.2\n0.4,0.5\n")
    with pytest.raises(setid.DataError, match="line 1: found '#N/A,0.3' above the table"):
        setid.IOData.from_csv(path, 0, 1)


def test_commas_that_may_be_decimal_marks_are_spoken_of(tmp_path: Path) -> None:
    data = setid.IOData.from_csv(written(tmp_path, "0,5,1,2\n1,5,2,4\n"), 0, 1)
    assert any("say decimal=','" in text for text in data.assumptions)
    whole = setid.IOData.from_csv(written(tmp_path, "0.5,5\n1.5,3\n"), 0, 1)
    assert whole.assumptions == ()


def test_points_are_no_decimal_marks_where_commas_are(tmp_path: Path) -> None:
    with pytest.raises(setid.DataError, match="line 1: found '1.500' beside numbers"):
        setid.IOData.from_csv(written(tmp_path, "1.500;2\n2;4\n"), 0, 1, decimal=",")


@pytest.mark.parametrize("units", ["V;mm;-", "V;mm;", ";mm;", "V;n/a;"])
def test_a_line_of_units_is_named_as_one(tmp_path: Path, units: str) -> None:
    """A channel without a unit is no number: spreadsheets leave its field empty."""
    path = written(tmp_path, f"u;y;note\n{units}\n1;2;ok\n3;4;ok\n")
    with pytest.raises(setid.DataError, match="second header, say header=2"):
        setid.IOData.from_csv(path, "u", "y")


@pytest.mark.parametrize(
    ("text", "header", "message"),
    [
        ("u,y\n", None, "found 1 lines and 1 of headers, expected samples"),
        ("# note\nu,y\nV,mm\n1,2\n", 3, "found 3 lines and 3 of headers"),
        ("# a\n# b\nu,y\n1,2\n3,4\n5,6\n", 3, "line 4: found a sample, '1 2', expected a header"),
        ("u,y\n1,2\n", 9, "found 2 lines and 9 of headers"),
    ],
)
def test_tables_of_headers_alone_are_refused(
    tmp_path: Path, text: str, header: int | None, message: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(setid.DataError, match=message) as told:
        setid.IOData.from_csv(path, "u", "y", header=header)
    assert str(path) in str(told.value)


@pytest.mark.parametrize(("decimal", "header"), [(";", None), (".", -1), (".", True), (".", 1.0)])
def test_wrong_arguments(tmp_path: Path, decimal: str, header: object) -> None:
    with pytest.raises(setid.DataError, match="decimal|header"):
        read_table(written(tmp_path, "1,2\n"), [0, 1], decimal, header)  # type: ignore[arg-type]


@pytest.mark.parametrize(("text", "names"), [("u,y\n1,2\n", ["u", "y"]), ("#c\n1 2\n", [0, 1])])
def test_names_are_told_from_numbers(tmp_path: Path, text: str, names: list[str | int]) -> None:
    assert column_names(written(tmp_path, text)) == names


@pytest.mark.parametrize("breaks", ["\x0b", "\x0c", "\x1c", "\u2028", "\x85"])
def test_only_line_feeds_and_returns_end_a_line(tmp_path: Path, breaks: str) -> None:
    with pytest.raises(setid.DataError, match="line 2"):
        setid.IOData.from_csv(written(tmp_path, f"u,y\n1,2{breaks}3,4\n"), "u", "y")


def test_empty_fields_at_the_ends_of_tabbed_lines_are_missing_samples(tmp_path: Path) -> None:
    data = setid.IOData.from_csv(written(tmp_path, "u\ty\n1\t2\n3\t\n\t6\n\t\n"), "u", "y")
    np.testing.assert_array_equal(data.u.ravel(), [1, 3, np.nan, np.nan])
    np.testing.assert_array_equal(data.y.ravel(), [2, np.nan, 6, np.nan])


def test_an_empty_first_column_between_tabs_keeps_its_number(tmp_path: Path) -> None:
    data = setid.IOData.from_csv(written(tmp_path, "\t1\t2\t9\n\t3\t4\t8\n"), 1, 2)
    assert (data.u.ravel().tolist(), data.y.ravel().tolist()) == ([1, 3], [2, 4])


@pytest.mark.parametrize("text", ["u,y\t\n1,2\t\n3,4\n", "u y\t\n1 2\t\n3 4\n"])
def test_tabs_behind_other_separators_are_no_fields(tmp_path: Path, text: str) -> None:
    found = read_table(written(tmp_path, text), ["u", "y"]).columns
    assert [column.tolist() for column in found] == [[1.0, 3.0], [2.0, 4.0]]


def test_blanks_around_a_table_of_blanks_are_no_fields(tmp_path: Path) -> None:
    path = written(tmp_path, "\t \n \t# note\nu y\n 1 2\t\n\t3 4 \n\t\n")
    data = setid.IOData.from_csv(path, "u", "y")
    assert (data.u.ravel().tolist(), data.y.ravel().tolist()) == ([1, 3], [2, 4])


@pytest.mark.parametrize(
    ("text", "decimal", "header", "names"),
    [
        ("0;1,5\n1;2\n", ",", None, [0, 1]),
        ("0,5 1,5\n1 2\n", ",", None, [0, 1]),
        ("2021,u\n1,2\n", ".", 1, ["2021", "u"]),
        ("1\t2\t\n3\t4\t\n", ".", None, [0, 1]),
        (" \t1\t2\n\t3\t4\n", ".", None, [1, 2]),
        ("1,2,\n3,4,5\n", ".", None, [0, 1, 2]),  # a first reading may be missing
        ("1,nan\n2,nan\n", ".", None, [0, 1]),
    ],
)
def test_columns_are_listed_as_the_table_is_read(
    tmp_path: Path, text: str, decimal: str, header: int | None, names: list[str | int]
) -> None:
    assert column_names(written(tmp_path, text), decimal, header) == names


@pytest.mark.parametrize("name", ["", "a\0b.csv", b"record.csv"])
def test_names_that_no_table_has_are_refused(name: object) -> None:
    with pytest.raises(setid.DataError, match="^path: found .* expected the name of a file"):
        setid.IOData.from_csv(name, "u", "y")  # type: ignore[arg-type]
