"""A study of controllers goes on where its file ends."""

from __future__ import annotations

import csv
from pathlib import Path

from benchmarks.control_study import FIELDS, begun


def test_plants_with_all_rows_are_kept_and_others_dropped(tmp_path: Path) -> None:
    path = tmp_path / "study.csv"
    assert begun(path) == set()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        for plant, snr in [(3, 60.0), (3, 40.0), (3, 25.0), (4, 60.0), (4, 40.0)]:
            writer.writerow({"plant": plant, "snr": snr})
        file.write("4,2")  # killed in the middle of a line
    assert begun(path) == {3}
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [(row["plant"], row["snr"]) for row in rows] == [
        ("3", v) for v in ("60.0", "40.0", "25.0")
    ]
