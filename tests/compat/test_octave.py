"""Scripts in MATLAB's language, run by GNU Octave: ``make test-octave``.

The scripts in ``tests/compat/octave`` hold their own expectations. All of them run in one session,
so that the child process is shared as it is in practice.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sparsepop_py.compat import matlab_server as door

PAGE = Path(__file__).resolve().parents[2] / "docs" / "matlab.md"
SCRIPTS = Path(__file__).resolve().parent / "octave"
OCTAVE = shutil.which("octave-cli")
pytestmark = [
    pytest.mark.octave,
    pytest.mark.skipif(
        OCTAVE is None, reason="GNU Octave is not installed (Debian: apt-get install octave)"
    ),
]

# one_child counts the children of its process, inside_matlab hides the way to them
EVERY = sorted(path.stem for path in SCRIPTS.glob("*.m") if path.stem != "inside_matlab")


def octave(*statements: str, way: str = "") -> str:
    """What Octave prints; the environment names the interpreter that runs the tests."""
    environment = {**os.environ, "SPARSEPOP_PYTHON": sys.executable, "SPARSEPOP_DOOR": way}
    paths = f"addpath('{door.folder()}', fullfile(pwd, 'on_path'));"
    words = [str(OCTAVE), "--norc", "--quiet", "--eval", " ".join([paths, *statements])]
    run = subprocess.run(words, cwd=SCRIPTS, env=environment, capture_output=True, text=True)
    return run.stdout + run.stderr


def verdicts(*names: str, way: str = "") -> dict[str, str]:
    """By script: ``ok``, or the message with which it ended, or all that was printed."""
    calls = [
        f"try, run('{name}.m'), disp('VERDICT {name} ok'), "
        f"catch problem, disp(['VERDICT {name} ' problem.message]), end;"
        for name in names
    ]
    printed = octave(*calls, way=way)
    found = dict.fromkeys(names, printed)
    for part in printed.split("VERDICT ")[1:]:
        name, _, verdict = part.partition(" ")
        found[name] = verdict.splitlines()[0] if verdict.startswith("ok") else verdict
    return found


@pytest.fixture(scope="module")
def by_pipe() -> dict[str, str]:
    return verdicts(*EVERY)


@pytest.mark.parametrize("name", EVERY)
def test_script(name: str, by_pipe: dict[str, str]) -> None:
    assert by_pipe[name] == "ok"


def test_a_child_started_by_java() -> None:
    """MATLAB without its own Python starts the child so."""
    if "started" not in octave("javaObject('java.util.ArrayList'); disp('started')"):
        pytest.skip("Octave finds no Java (Debian: apt-get install default-jre-headless)")
    assert verdicts("errors_and_warnings", "overhead", way="java") == {
        "errors_and_warnings": "ok",
        "overhead": "ok",
    }


def test_python_inside_matlab() -> None:
    """With functions in place of MATLAB's own: this shows the calls, not MATLAB."""
    assert verdicts("inside_matlab", way="py") == {"inside_matlab": "ok"}


def test_an_interpreter_without_the_package_is_named() -> None:
    printed = octave("setenv('SPARSEPOP_PYTHON', '/bin/false'); sparsePOP('quartics(1, -1)')")
    assert "/bin/false ended without an answer" in printed
    assert "SPARSEPOP_PYTHON" in printed


def test_the_example_of_the_documentation() -> None:
    """Inside the disc the objective has a saddle at 0 alone, so its minimum is on the circle."""
    example = re.search(r"^```matlab\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert example
    printed = octave("\n" + example.group(1))
    found = re.search(r"OPTIMAL: (\S+) <= minimum <= (\S+)", printed)
    assert found, printed
    angle = np.linspace(0, np.pi, 100001)
    x, y = np.sqrt(2) * np.cos(angle), np.sqrt(2) * np.sin(angle)
    minimum = (x**4 - 3 * x * y + y**2).min()
    assert [float(end) for end in found.groups()] == pytest.approx([minimum] * 2, abs=3e-6)
