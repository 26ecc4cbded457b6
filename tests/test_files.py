"""Files are written whole or not at all, and paths of other types are refused in our words."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import sparsepop_py as sp
from sparsepop_py import files, plots
from sparsepop_py.errors import FormatError, OutputError
from sparsepop_py.io.sdpa import write_info


def problem() -> sp.Problem:
    x, y = sp.variables(2, ["x", "y"])
    return sp.Problem(x * y, [x**2 + y**2 <= 1])


def program() -> sp.ConicProgram:
    return sp.assemble(sp.relax(problem()), problem().objective)


WRITERS: dict[str, Callable[[Any], Any]] = {
    "json": lambda path: sp.write_json(problem(), path),
    "gms": lambda path: sp.write_gms(problem(), path),
    "mat": lambda path: sp.write_mat(problem(), path),
    "sdpa": lambda path: sp.write_sdpa(program(), path),
    "info": lambda path: write_info(path, np.array([1]), np.array([1.0]), np.array([0.0])),
    "npz": lambda path: program().save(path),
    "png": lambda path: plots.save_plot(sp.solve(problem()), path),
}
READERS: dict[str, Callable[[Any], Any]] = {
    "json": sp.read_json,
    "gms": sp.read_gms,
    "mat": sp.read_mat,
    "sdpa": sp.read_sdpa,
    "npz": sp.ConicProgram.load,
    "any": sp.read,
}


def full(_: int) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_full_disk_leaves_what_was_there(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"file.{kind}"
    path.write_bytes(b"a good result")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match=rf"file.{kind}: cannot be written: No space left") as e:
        WRITERS[kind](path)
    assert isinstance(e.value, OSError) and isinstance(e.value, sp.SparsePOPError)
    assert path.read_bytes() == b"a good result"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kind", WRITERS)
def test_an_interrupt_leaves_what_was_there(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"file.{kind}"

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        WRITERS[kind](path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", WRITERS)
def test_writers_write_and_keep_links_and_modes(kind: str, tmp_path: Path) -> None:
    target, link = tmp_path / f"target.{kind}", tmp_path / f"link.{kind}"
    target.write_bytes(b"old")
    target.chmod(0o640)
    link.symlink_to(target)
    WRITERS[kind](str(link))
    assert link.is_symlink() and target.read_bytes() not in (b"old", b"")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    fresh, umask = tmp_path / f"fresh.{kind}", os.umask(0o027)
    try:
        WRITERS[kind](fresh)
    finally:
        os.umask(umask)
    assert stat.S_IMODE(fresh.stat().st_mode) == 0o640
    assert {p.name for p in tmp_path.iterdir()} == {target.name, link.name, fresh.name}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_device_is_written_directly() -> None:
    with pytest.raises(OutputError, match="/dev/full: cannot be written: No space left"):
        files.write_text("/dev/full", "a" * 10**6)
    files.write_text("/dev/null", "a")


@pytest.mark.parametrize("kind", WRITERS)
def test_places_that_are_not_there_are_named(kind: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"):
        WRITERS[kind](tmp_path / "nowhere" / f"file.{kind}")


WRONG = [None, 3, 1.5, b"bytes", ["a"], "", "a\0b", sp]


@pytest.mark.parametrize("path", WRONG, ids=[str(k) for k in range(len(WRONG))])
@pytest.mark.parametrize("kind", WRITERS)
def test_other_types_are_no_paths_to_write(kind: str, path: Any) -> None:
    with pytest.raises(FormatError, match=r"path: found .*, expected"):
        WRITERS[kind](path)


@pytest.mark.parametrize("path", WRONG, ids=[str(k) for k in range(len(WRONG))])
@pytest.mark.parametrize("kind", READERS)
def test_other_types_are_no_paths_to_read(kind: str, path: Any) -> None:
    with pytest.raises(FormatError, match=r"path: found .*, expected"):
        READERS[kind](path)


@pytest.mark.parametrize("kind", READERS)
def test_directories_and_absent_files_are_named(kind: str, tmp_path: Path) -> None:
    folder = tmp_path / "folder.json"
    folder.mkdir()
    with pytest.raises(FormatError, match=r"folder\.json: .*directory"):
        READERS[kind](folder)
    with pytest.raises(FormatError, match=r"absent\.json: .*no such file"):
        READERS[kind](tmp_path / "absent.json")


def test_files_that_are_too_large_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "LARGEST", 100)
    path = tmp_path / "large.json"
    path.write_text(" " * 101)
    with pytest.raises(FormatError, match=r"large.json: found more than 100 bytes"):
        sp.read_json(path)


def test_pictures_have_known_endings(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"found the ending 'xyz', expected one of .*png"):
        plots.save_plot(sp.solve(problem()), tmp_path / "picture.xyz")
    assert "png" in Figure().canvas.get_supported_filetypes()


def test_an_archive_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sparsepop_py.conic import program as stored

    program().save(tmp_path / "program.npz")
    monkeypatch.setattr(stored, "_LARGEST", 100)
    with pytest.raises(FormatError, match=r"found \d+ bytes of arrays, expected at most 100"):
        sp.ConicProgram.load(tmp_path / "program.npz")
