"""sparsePOPintervals: the 2p calls of an identification script as one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from struct_cases import struct

import sparsepop_py as sp
from sparsepop_py.compat import matlab_server
from sparsepop_py.compat.intervals import interval_details
from sparsepop_py.errors import ParameterWarning, ProblemError

FREE = 1e10
# x1^2 + x2^2 <= 4 and x1 + x2 >= 0: x1 and x2 from -sqrt(2) to 2; x3 is free
DISC = struct([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [4, -1, -1])
HALF = struct([[1, 0, 0], [0, 1, 0]], [1, 1])
FREE3 = ([-FREE] * 3, [FREE] * 3)
ROOT = 2**0.5


def test_ends_are_proved_in_the_order_of_the_indices() -> None:
    lo, hi = sp.sparsePOPintervals([DISC, HALF], *FREE3, [2, 1, 2], {"relaxOrder": 2})
    assert lo == pytest.approx([-ROOT] * 3, abs=1e-5) and np.all(lo <= -ROOT)
    assert hi == pytest.approx([2] * 3, abs=1e-5) and np.all(hi >= 2)


def test_a_free_variable_has_no_ends() -> None:
    out = sp.sparsePOPintervals([DISC, HALF], *FREE3, 3)
    assert (out.lo.tolist(), out.hi.tolist()) == ([-np.inf], [np.inf])


@pytest.mark.parametrize("indices", [None, [], "a"])
def test_all_variables(indices: Any) -> None:
    lo, hi = sp.sparsePOPintervals([], [0, 1], [2, 3], indices)
    assert lo == pytest.approx([0, 1]) and hi == pytest.approx([2, 3])


def test_no_feasible_point_leaves_an_empty_interval() -> None:
    far = struct([[0, 0, 0], [1, 0, 0]], [-5, 1])
    lo, hi = sp.sparsePOPintervals([DISC, far], *FREE3, [1, 2])
    assert np.all(lo == np.inf) and np.all(hi == -np.inf)


def test_auto_closes_what_one_relaxation_leaves_open() -> None:
    """x2 = x1^3 - x1 on [-1.2, 1.2]: from -0.528 to 0.528, both attained at the ends."""
    curve = struct([[3, 0], [1, 0], [0, 1]], [1, -1, -1], -1)
    box = ([-1.2, -FREE], [1.2, FREE])
    param = {"effort": "auto", "timeLimit": 20, "gap": 1e-5}
    found = interval_details([curve], *box, [2], param)
    assert found.status == [["OPTIMAL", "OPTIMAL"]]
    assert found.lo == pytest.approx([-0.528], abs=1e-4) and found.lo[0] <= -0.528
    assert found.hi == pytest.approx([0.528], abs=1e-4) and found.hi[0] >= 0.528
    assert found.lo[0] <= found.innerLo[0] <= found.innerHi[0] <= found.hi[0]
    for result in found.results[0]:
        assert result.certificate is not None
        assert result.certificate.verify(result.problem).ok


@pytest.mark.parametrize("indices", [0, 4, 1.5, [1, "x"], True])
def test_wrong_indices(indices: Any) -> None:
    with pytest.raises(ProblemError, match="indices: found .*, expected variables from 1 to 3"):
        sp.sparsePOPintervals([DISC], *FREE3, indices)


def test_parameters_are_checked() -> None:
    with pytest.raises(ProblemError, match=r"param\.effort"):
        sp.sparsePOPintervals([DISC], *FREE3, 1, {"effort": "all"})
    with pytest.warns(ParameterWarning, match="did you mean timeLimit") as caught:
        sp.sparsePOPintervals([DISC], *FREE3, 1, {"timelimit": 3})
    assert caught[0].filename == __file__
    with pytest.raises(ProblemError, match="lbd: found nothing"):
        sp.sparsePOPintervals([DISC], [], [])


def test_a_question_in_a_file(tmp_path: Path) -> None:
    arguments = np.empty((1, 5), dtype=object)
    arguments[0] = [[DISC, HALF], [-FREE] * 3, [FREE] * 3, [1.0, 2.0], {"relaxOrder": 2.0}]
    path = tmp_path / "question.mat"
    given = {"task": "sparsePOPintervals", "arguments": arguments, "folder": str(tmp_path)}
    scipy.io.savemat(path, given)
    matlab_server.answer(path)
    answer = scipy.io.loadmat(path)
    assert answer["error"].size == 0
    detail = answer["outputs"][0, 0][0, 0]
    assert detail["lo"].shape == (2, 1)
    assert detail["lo"].ravel() == pytest.approx([-ROOT] * 2, abs=1e-5)
    assert detail["hi"].ravel() == pytest.approx([2] * 2, abs=1e-5)
    assert detail["status"].shape == (2, 2)


@pytest.mark.parametrize("param", [{}, {"tighten": 1, "relaxOrder": 2}])
def test_attained_ends_are_those_of_the_equations_as_given(param: dict[str, Any]) -> None:
    """x^2 = 1 and x >= 0 say x = 1; with 0 <= x^2 - 1 <= 9 / 4 the bound is sqrt(13) / 2.

    The relaxed equation is divided by 9, its largest coefficient in [0, 3]: 1/4 of it is 9/4.
    """
    row = struct([[0], [2]], [-1, 1], typeCone=-1)
    found = interval_details([row], [0], [3], 1, {"eqTolerance": 0.25, **param})
    assert found.hi == pytest.approx([13**0.5 / 2], abs=1e-5)
    assert found.innerHi == pytest.approx([1], abs=1e-9) and found.lo <= found.innerLo
    assert found.status[0][1] == "BOUNDED"
