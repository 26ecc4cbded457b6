"""Identification problems as SparsePOP's structs: rows of the notes, ends by two calls each."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import setid
import sparsepop_py as sp

ROOT = Path(setid.__file__).resolve().parent.parent
DATA = setid.IOData([1.0, -2.0, 0.5, 3.0], [0.3, 1.2, -0.7, 0.9])
SECOND = setid.TransferFunction(na=2, nb=3)


def test_rows_are_those_of_figure_3_12() -> None:
    """At k = 3 twelve terms in theta, eta and xi; each reading comes with its noise sample."""
    noise = setid.Noise(output=0.1, input=0.2)
    _, rows, lower, upper = setid.to_structs(DATA, SECOND, noise)
    row = rows[0]
    assert (row["typeCone"], row["dimVar"], row["degree"], row["noTerms"]) == (-1, 13, 2, 12)
    y, u = DATA.y.ravel(), DATA.u.ravel()
    theta, eta, xi = range(5), range(5, 9), range(9, 13)
    wanted = {(): y[2], (eta[2],): -1.0}
    for i in (1, 2):
        wanted |= {(theta[i - 1],): y[2 - i], (theta[i - 1], eta[2 - i]): -1.0}
    for j in (0, 1, 2):
        wanted |= {(theta[2 + j],): -u[2 - j], (theta[2 + j], xi[2 - j]): 1.0}
    found = {
        tuple(np.flatnonzero(exponents).tolist()): float(coefficient)
        for exponents, coefficient in zip(row["supports"], row["coef"].ravel(), strict=True)
    }
    assert found == wanted
    assert lower.tolist() == [-1e10] * 5 + [-0.1] * 4 + [-0.2] * 4
    assert upper.tolist() == [1e10] * 5 + [0.1] * 4 + [0.2] * 4
    assert len(rows) == 2  # k = 3, 4


@pytest.mark.parametrize(("target", "sign", "place"), [("b1", 1.0, 3), ("-b1", -1.0, 3)])
def test_the_target_is_the_objective(target: str, sign: float, place: int) -> None:
    objective, *_ = setid.to_structs(DATA, SECOND, setid.Noise(0.1), target=target)
    assert np.flatnonzero(objective["supports"]).tolist() == [place]
    assert float(np.ravel(objective["coef"])[0]) == sign


def test_unknown_targets_are_refused() -> None:
    with pytest.raises(setid.SetidError, match="target: found 'c1', expected one of a1, a2"):
        setid.to_structs(DATA, SECOND, setid.Noise(0.1), target="c1")


def test_two_calls_a_parameter_give_the_interval() -> None:
    """Equation errors: the ends are those of linear programs, as in the first laboratory."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.5)
    exact = setid.identify(data, model, noise)
    for name in model.parameters:
        ends = [
            sign
            * sp.sparsePOP(
                *setid.to_structs(data, model, noise, target=text), {"printLevel": 0}
            ).SDPobjValue
            for sign, text in ((1.0, name), (-1.0, f"-{name}"))
        ]
        assert ends == pytest.approx(exact.intervals[name].outer, abs=1e-5)


@pytest.mark.slow
def test_the_example_brackets_the_truth(tmp_path: Path) -> None:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    script = ROOT / "examples" / "structs_from_identification.py"
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if re.match(r"[ab]\d ", line)]
    assert len(rows) == 5 and "12 terms each" in done.stdout
    for row in rows:
        truth, low, high, first, last, closer, close = (
            float(v) for v in re.findall(r"-?\d+\.\d+", row)
        )
        assert low <= first <= last <= high and low <= truth <= high
        assert low - 1e-3 <= closer <= truth <= close <= high + 1e-3
