"""The examples run, and print what closed forms say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def run(name: str, *arguments: str) -> str:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-W", "error", str(ROOT / "examples" / f"{name}.py"), *arguments],
        env={**os.environ, "PYTHONPATH": path.rstrip(os.pathsep)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_gradients() -> None:
    text = run("neural_gradients")
    rows = re.findall(r"^ +([\d.]+) +(\d+) +(\S+) +(\S+) +(\w+)", text, re.M)
    assert len(rows) == 12
    for alpha, t, exact, numeric, verdict in rows:
        truth = int(t) * float(alpha) ** (int(t) - 1)
        assert float(exact) == pytest.approx(truth, rel=1e-5)
        assert float(numeric) == pytest.approx(truth, rel=1e-4)
        assert verdict == ("stable" if float(alpha) < 1 else "open")


@pytest.mark.slow
def test_measured_records() -> None:
    text = run("neural_records", "--samples", "60")
    assert text.count("verified: True") == 2
    assert "holds 57 validation readings" in text and "holds 58 validation readings" in text
    assert "proved>" in text.splitlines()[-1]
