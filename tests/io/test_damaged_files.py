"""Damaged files are refused in our words, or what they say is still checked: nothing else."""

from __future__ import annotations

import io
import json
import math
import random
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py.compat import mat_structure
from sparsepop_py.compat.mat_structure import check_structure
from sparsepop_py.errors import FormatError, SparsePOPError

FOLDER = Path(__file__).parent / "data" / "stored"

# ---- JSON ----------------------------------------------------------------------------------------

ODD = [
    *(None, True, False, 0, -1, 1.5, 10**400, 2**63, -(2**70), 2**31 - 1, 10**12, 1e308),
    *("", "inf", "nan", "-inf", "abc", "OPTIMAL", "Propagation"),
    *([], [[]], [1, 2, 3], [None], ["x1", "x1"], {}, {"a": 1}),
    {"type": "f8", "shape": [], "data": [1.0]},
    {"type": "i4", "shape": [1], "data": [1]},
    {"type": ["f8"], "shape": [1], "data": [1]},
]

# Results and certificates with the minima of their problems, see test_stored_files.py.
FILES = {
    "hill.result.json": -0.125,
    "each_region1.result.json": -1.0,
    "gram_rosenbrock.result.json": 1.0,
    "infeasible_farkas.result.json": math.inf,
    "circle.certificate.json": -math.sqrt(5),
    "circle.problem.json": None,
}


def places(found: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    if isinstance(found, dict):
        for key, value in found.items():
            yield from places(value, (*path, key))
    elif isinstance(found, list):
        for k, value in enumerate(found[:6]):
            yield from places(value, (*path, k))


def mutated(text: str, rng: random.Random) -> str:
    """The text with one value dropped or replaced by something odd."""
    found = json.loads(text)
    *above, last = rng.choice([path for path in places(found) if path])
    holder = found
    for key in above:
        holder = holder[key]
    if rng.random() < 0.25:
        del holder[last]
    else:
        holder[last] = rng.choice(ODD)
    return json.dumps(found)


def texts(name: str) -> list[str]:
    """A file that is stored, and the same as it is written today."""
    return [(FOLDER / name).read_text(), sp.to_json(sp.read_json(FOLDER / name))]


def check_mutations(name: str, seeds: range) -> int:
    """Read mutated texts; how many were accepted, and then prove nothing false."""
    circle, accepted = sp.read_json(FOLDER / "circle.problem.json"), 0
    optimum, originals = FILES[name], texts(name)
    for seed in seeds:
        try:
            found = sp.from_json(mutated(originals[seed % 2], random.Random(seed)))
        except SparsePOPError as error:
            assert str(error)
            continue
        accepted += 1
        if isinstance(found, sp.Certificate):
            verdict = found.verify(circle)
            assert verdict.bound <= optimum
            assert not verdict.ok or found.bound <= optimum
        elif isinstance(found, sp.Result):
            known = found.problem.fingerprint == sp.from_json(originals[1]).problem.fingerprint
            assert not known or found.lower_bound <= optimum <= found.upper_bound
    return accepted


@pytest.mark.filterwarnings("ignore:Options.skip")
@pytest.mark.parametrize("name", FILES)
def test_json_with_other_values_is_refused_or_checked(name: str) -> None:
    assert check_mutations(name, range(200)) < 100


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Options.skip")
@pytest.mark.parametrize("name", FILES)
def test_json_with_other_values_is_refused_or_checked_many(name: str) -> None:
    assert check_mutations(name, range(200, 2200)) < 1000


def test_sweeps_without_end_are_not_replayed() -> None:
    """x <= 0.999 y, y <= 0.999 x in [0, 1]^2 creeps to 0 without arriving."""
    x, y = sp.variables(2)
    problem = sp.Problem(-x, [x <= 0.999999 * y, y <= 0.999999 * x], 0, 1)
    text = sp.to_json(sp.Certificate(problem.fingerprint, -1.0))
    step = {"is": "Propagation", "sweeps": 2**62, "uses_cutoff": False}
    found = json.loads(text)
    found["certificate"][0]["parts"][0]["steps"] = [step]
    verdict = sp.from_json(json.dumps(found)).verify(problem)
    assert verdict.ok and -1.0 < verdict.bound <= 0.0


# ---- MAT -----------------------------------------------------------------------------------------


def some_problem() -> sp.Problem:
    x, y = sp.variables(2, ["a", "b"])
    return sp.Problem(x * y, [x**2 + y**2 <= 1, x - y == 0.1], -1, [1, np.inf], sense="max")


def stored(**how: Any) -> bytes:
    """A problem as a MAT file, with a sparse matrix beside it."""
    file = io.BytesIO()
    objective, rows, lower, upper = sp.to_structs(some_problem())
    variables = {"objPoly": objective, "ineqPolySys": np.array(rows, object)}
    matrix = sps.csc_matrix(np.array([[1.0, 0.0, 2.0], [0.0, 0.0, 3.0]]))
    more = {"lbd": lower, "ubd": upper, "names": np.array(["a", "b"], object), "sense": "max"}
    scipy.io.savemat(file, {**variables, **more, "matrix": matrix, "z": np.array([1 + 2j])}, **how)
    return file.getvalue()


def damaged(data: bytes, rng: random.Random) -> bytes:
    """One bit or byte changed, or the end cut off."""
    if rng.random() < 0.2:
        return data[: rng.randrange(len(data))]
    changed, place = bytearray(data), rng.randrange(len(data))
    changed[place] = rng.choice([changed[place] ^ 1 << rng.randrange(8), rng.randrange(256), 255])
    return bytes(changed)


@pytest.mark.parametrize("compressed", [False, True])
def test_damaged_mat_files_are_read_or_refused(compressed: bool, tmp_path: Path) -> None:
    data, path = stored(do_compression=compressed), tmp_path / "damaged.mat"
    refused = 0
    for seed in range(400):
        path.write_bytes(damaged(data, random.Random(seed)))
        try:
            sp.read_mat(path)
        except SparsePOPError as error:
            refused += 1
            assert str(error)
    assert refused > 100


@pytest.mark.slow
def test_damaged_mat_files_are_read_or_refused_many(tmp_path: Path) -> None:
    data, path = stored(), tmp_path / "damaged.mat"
    for seed in range(1000, 20_000):
        path.write_bytes(damaged(data, random.Random(seed)))
        try:
            sp.read_mat(path)
        except SparsePOPError:
            continue


@pytest.mark.parametrize("length", [0, 1, 3, 4, 100, 127, 129, 130, 200, 500])
def test_truncated_mat_files_are_refused(length: int, tmp_path: Path) -> None:
    path = tmp_path / "short.mat"
    path.write_bytes(stored()[:length])
    with pytest.raises(SparsePOPError):
        sp.read_mat(path)


# SciPy's own files for tests: MATLAB 5 to 7.4 on four machines, big-endian among them.
EXAMPLES = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
REFUSED = {
    *("broken_utf8.mat", "parabola.mat", "some_functions.mat", "sqr.mat", "testfunc_7.4_GLNX86.mat")
}


@pytest.mark.skipif(not EXAMPLES.is_dir(), reason="SciPy is installed without its tests")
def test_files_of_other_programs_pass() -> None:
    passed = 0
    for path in sorted(EXAMPLES.glob("*.mat")):
        data = path.read_bytes()
        try:
            scipy.io.loadmat(io.BytesIO(data))
        except Exception:  # damaged on purpose
            continue
        if path.name in REFUSED:  # function handles, and text that is no UTF-8
            with pytest.raises(FormatError, match="found .*, expected"):
                check_structure(data)
        else:
            check_structure(data)
            passed += 1
    assert passed > 50


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content


def test_a_small_file_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mat_structure, "LARGEST", 10**6)
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    bomb = element(15, zlib.compress(bytes(5 * 10**6)))
    path = tmp_path / "bomb.mat"
    path.write_bytes(header + bomb)
    assert len(bomb) < 10**4
    with pytest.raises(FormatError, match=r"bomb.mat: .*more than 1000000 bytes after decompress"):
        sp.read_mat(path)


def test_cells_in_cells_end_somewhere(tmp_path: Path) -> None:
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    empty = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<II", 0, 0))
    cell = element(14, empty + element(1, b""))
    one = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<II", 1, 1))
    for _ in range(2000):
        cell = element(14, one + element(1, b"") + cell)
    path = tmp_path / "deep.mat"
    path.write_bytes(header + cell)
    with pytest.raises(FormatError, match="more arrays, expected at most"):
        sp.read_mat(path)


def test_indices_of_sparse_matrices_are_checked() -> None:
    data = stored()
    place = data.index(b"matrix")
    rows = data.index(struct.pack("<III", 0, 0, 1), place)  # rows 0, 0, 1 of three values
    check_structure(data)
    for wrong in (2, -1, 10**9):
        changed = data[:rows] + struct.pack("<i", wrong) + data[rows + 4 :]
        with pytest.raises(FormatError, match="indices outside the matrix"):
            check_structure(changed)


# ---- NPZ -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("flag", [0x01, 0x20])
def test_archives_with_passwords_or_patches_are_refused(flag: int, tmp_path: Path) -> None:
    """Bits 0 and 5 of the flags in a header of a ZIP file mean these; zipfile reads neither."""
    path = tmp_path / "program.npz"
    problem = some_problem()
    sp.assemble(sp.relax(problem), problem.objective).save(path)
    data = bytearray(path.read_bytes())
    for start, place in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        at = data.find(start)
        while at >= 0:
            data[at + place] |= flag
            at = data.find(start, at + 1)
    path.write_bytes(data)
    with pytest.raises(FormatError, match=r"program.npz: expected a saved conic program"):
        sp.ConicProgram.load(path)
