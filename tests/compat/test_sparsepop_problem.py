"""sparsePOP: functions as input, relaxed equations, error bounds, solver settings, all outputs."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.compat.sparsepop import with_tolerance
from sparsepop_py.errors import ProblemError

QUIET = {"printLevel": 0}


def disc() -> sp.Problem:
    """Minimum -sqrt 2 at -(1, 1) / sqrt 2."""
    x, y = sp.variables(2)
    return sp.Problem(x + y, [x**2 + y**2 <= 1], -1, 1)


def scaled_disc(radius: float, power: int = 2) -> Any:
    """The four structs of the disc of that radius."""
    x, y = sp.variables(2)
    return sp.to_structs(sp.Problem(x + y, [x**power + y**power <= radius**power], -9, 9))


def nothing() -> int:
    return 7


# ---- functions -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "minimum"),
    [
        (disc, -(2**0.5)),
        (lambda: scaled_disc(3.0), -3 * 2**0.5),
        (f"{__name__}:disc", -(2**0.5)),
        (f"{__name__}:scaled_disc(3, 2)", -3 * 2**0.5),
        (f" {__name__}:scaled_disc( 3. ) ", -3 * 2**0.5),
        ("rosenbrock(3)", None),
    ],
    ids=lambda value: getattr(value, "__name__", None) or str(value),
)
def test_functions(given: Any, minimum: float | None) -> None:
    value = sp.sparsePOP(given, {**QUIET, "relaxOrder": 2})[1]
    if minimum is None:
        minimum = sp.solve(sp.problems.rosenbrock(3)).upper_bound
    assert minimum - 1e-5 < value <= minimum


WRONG: list[tuple[Any, str]] = [
    (
        "line(3)",
        r"objPoly: found the string 'line\(3\)', expected the name of a .gms file, 'module",
    ),
    ("no_such_module:f", r"found the string 'no_such_module:f', expected .* No module named"),
    ("RosenbrockLS", r"missing a required argument: 'n'\), expected .* rosenbrock\(n\)"),
    ("chained_wood(8, 2)", r"\(too many positional arguments\), expected .* chained_wood\(n\)"),
    ('chained_wood("a")', "n: found 'a', expected a multiple of 4, at least 4"),
    ("BroydenBand(5.0)", "n: found 5.0, expected an integer from 2 to 1000000"),
    (f"{__name__}:absent", r"absent', expected the name of a .gms file"),
    (f"{__name__}:scaled_disc(open('x'))", r"with arguments that are literals or without"),
    (f"{__name__}:scaled_disc(1", r"expected the name of a .gms file"),
    (f"{__name__}:nothing", r"found int, expected a Problem or objPoly, ineqPolySys, lbd, ubd"),
    (nothing, r"nothing: found int, expected a Problem or objPoly"),
]


@pytest.mark.parametrize(("given", "message"), WRONG)
def test_wrong_functions(given: Any, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        sp.sparsePOP(given, QUIET)


# ---- relaxed equations -----------------------------------------------------------------------


@pytest.mark.parametrize("tighten", [0, 1])
def test_relaxed_equations_keep_the_bound_valid(tighten: int) -> None:
    """min x with x - y = 0 and x + y = 1 is 1/2; with 0 <= h <= eps each it is 1/2.

    max x, which is 1/2 too, becomes 1/2 + eps: one-sided, as in the original.
    """
    x, y = sp.variables(2)
    rows = [x - y == 0, x + y == 1]
    for objective, relaxed in ((x, 0.5), (-x, -0.5 - 1e-2)):
        problem = sp.Problem(objective, rows, 0, 1)
        output = sp.sparsePOP(problem, {**QUIET, "tighten": tighten, "eqTolerance": 1e-2})
        minimum = float(objective([0.5, 0.5]))
        assert output.SDPobjValue <= minimum <= output.POP.upperBound
        assert output.SDPobjValue == pytest.approx(relaxed, abs=1e-5)
        assert output.POP.upperBound == pytest.approx(minimum, abs=1e-9)
        assert output.POP.certificate.verify(output.POP.result.problem).ok
        assert output.POP.result.problem is not problem
        open_ = minimum - relaxed > 1e-3
        assert output.POP.status is (sp.Status.BOUNDED if open_ else sp.Status.OPTIMAL)


@pytest.mark.parametrize("value", [0.7, 1e10 / 3])
def test_relaxing_an_equation_rounds_nothing_that_matters(value: float) -> None:
    """The end of 0 <= x - value <= 1e-3 is no double, but the equation holds in the larger set."""
    (x,) = sp.variables(1)
    larger = with_tolerance(sp.Problem(-x, [x == value], -1e10, 1e10), 1e-3, scaled=False)
    assert larger.rounding == ()
    low, high = (Fraction(row.polynomial.constant_term) for row in larger.constraints)
    assert -low == Fraction(value) <= high
    assert abs(high - Fraction(value) - Fraction(1e-3)) <= Fraction(np.spacing(value)) / 2


def test_an_empty_relaxed_set_is_empty() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x + y == 3], 0, 1)
    output = sp.sparsePOP(problem, {**QUIET, "eqTolerance": 1e-3})
    assert output.POP.status is sp.Status.INFEASIBLE
    loose = sp.sparsePOP(sp.Problem(x, [x + y == 2.001], 0, 1), {**QUIET, "eqTolerance": 0.5})
    assert loose.POP.status is sp.Status.INFEASIBLE  # h >= 0 holds nowhere: one-sided
    other = sp.sparsePOP(sp.Problem(x, [-x - y == -2.001], 0, 1), {**QUIET, "eqTolerance": 0.5})
    assert other.POP.status is not sp.Status.INFEASIBLE
    assert other.POP.upperBound == np.inf  # no point of the given problem


# ---- error bounds ----------------------------------------------------------------------------


@pytest.mark.parametrize("index", ["a", [1, 2], 1, [[1], [2], "a"]], ids=str)
def test_error_bounds_hold_every_minimiser(index: Any) -> None:
    """Points of the disc with x + y <= -1.4 lie in a cap of half width 0.2 about its middle."""
    level = -1.4
    param = {**QUIET, "relaxOrder": 2, "errorBdIdx": index, "fValueUbd": level}
    POP = sp.sparsePOP(disc(), param).POP
    sets = {"a": [[0, 1]], "[1, 2]": [[0, 1]], "1": [[0]]}.get(str(index), [[0], [1], [0, 1]])
    assert len(POP.zeta) == len(POP.xCenter) == len(sets)
    angle = np.linspace(-np.pi, np.pi, 20001)
    edge = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cap = edge[edge.sum(axis=1) <= level]
    for chosen, centre, zeta in zip(sets, POP.xCenter, POP.zeta, strict=True):
        far = np.square(cap - centre)[:, chosen].sum(axis=1).max()
        assert far <= zeta < 2 * far + 1e-3


def test_error_bounds_by_default_and_of_a_maximum(tmp_path: Any) -> None:
    POP = sp.sparsePOP(disc(), {**QUIET, "relaxOrder": 2, "errorBdIdx": "a"}).POP
    best = np.full(2, -(0.5**0.5))
    assert np.square(POP.xCenter[0] - best).sum() <= POP.zeta[0] < 1e-2
    path = tmp_path / "largest.gms"
    x, y = sp.variables(2)
    sp.write_gms(sp.Problem(-x - y, [x**2 + y**2 <= 1], -1, 1, sense="max"), path)
    param = {**QUIET, "relaxOrder": 2, "errorBdIdx": "a", "fValueUbd": 1.4}
    POP = sp.sparsePOP(str(path), param).POP
    assert 0.02 < POP.zeta[0] < 0.1
    with pytest.raises(ProblemError, match=r"errorBdIdx: found 3, expected at most 2"):
        sp.sparsePOP(disc(), {**QUIET, "errorBdIdx": [3]})


# ---- the point and the solver's report -------------------------------------------------------


@pytest.mark.parametrize("tighten", [0, 1])
def test_numerr_compares_with_the_tolerance_that_was_asked_for(tighten: int) -> None:
    """A solver that is stopped early has the same errors whatever was asked for."""
    few = {**QUIET, "tighten": tighten, "relaxOrder": 2, "SDPsolverMaxIter": 5}
    reached = np.abs(sp.sparsePOP(disc(), few).SDPsolverInfo.err).max()
    assert reached > 1e-7
    for tolerance, numerr in ((2 * reached, 0), (reached / 2, 1), (1e-9, 1)):
        info = sp.sparsePOP(disc(), {**few, "SDPsolverEpsilon": tolerance}).SDPsolverInfo
        assert (np.abs(info.err).max() > tolerance, info.numerr) == (bool(numerr), numerr)


@pytest.mark.parametrize("param", [{}, {"tighten": 0}, {"tighten": 0, "relaxOrder": 3}])
def test_the_vector_is_filled_where_no_point_was_proved(param: dict[str, Any]) -> None:
    """x1^2 = 2 has no point in doubles near which the solver's moments end exactly."""
    x1, x2 = sp.variables(2)
    problem = sp.Problem(x1 + x2**2, [x1**2 == 2], lower=-3, upper=3)
    POP = sp.sparsePOP(problem, {**QUIET, **param, "localSearch": 0}).POP
    assert POP.upperBound == np.inf
    assert POP.xVect.shape == (2,) and np.isfinite(POP.xVect).all()
    assert POP.violation == pytest.approx(abs(POP.xVect[0] ** 2 - 2))
    assert POP.violation == -POP.absError
    assert POP.objValue == pytest.approx(POP.xVect[0] + POP.xVect[1] ** 2)


def test_errors_of_matrices_are_their_least_eigenvalues() -> None:
    """diag(-1, -2) has the trace -3 and the least eigenvalue -2; 0 >= |(3, 4)| lacks 5."""
    line = {"typeCone": 1, "dimVar": 1, "noTerms": 1, "supports": [[1]], "coef": [1.0]}
    constant = {"dimVar": 1, "noTerms": 1, "supports": [[0]]}
    matrix = {**constant, "typeCone": 3, "sizeCone": 2, "coef": [[-1.0, 0.0, 0.0, -2.0]]}
    cone = {**constant, "typeCone": 2, "sizeCone": 3, "coef": [[0.0, 3.0, 4.0]]}
    for row, error in ((matrix, -2.0), (cone, -5.0)):
        POP = sp.sparsePOP(line, [row], [0], [1], QUIET).POP
        assert (POP.status, POP.absError) == ("INFEASIBLE", pytest.approx(error, abs=1e-9))


def test_the_vector_is_filled_where_nothing_is_known() -> None:
    (x,) = sp.variables(1)
    POP = sp.sparsePOP(sp.Problem(x**3, upper=-2), {**QUIET, "localSearch": 0}).POP
    assert POP.xVect.shape == (1,) and POP.violation is not None


def test_the_report_says_what_the_vector_is(capsys: pytest.CaptureFixture[str]) -> None:
    """x^2 <= -2 has no point: 0, which misses it by 2, is not nearly feasible."""
    x, y = sp.variables(2)
    output = sp.sparsePOP(sp.Problem(x, [x**2 <= -2], -2, 2), {"localSearch": 0})
    assert (output.POP.status, output.POP.violation) == ("INFEASIBLE", 2)
    printed = capsys.readouterr().out
    assert "nearly feasible" not in printed
    assert "point of the bounds nearest to 0, not proved" in printed
    # the plain relaxation is not bounded, and its point is the one that the search has proved
    output = sp.sparsePOP(sp.Problem(x * y, [x**2 - y**2 <= 2]), {"tighten": 0})
    assert output.SDPsolverInfo.pinf == 1
    assert output.POP.xVect.tolist() == output.POP.result.attained.x.tolist()
    printed = capsys.readouterr().out
    assert "first moments" not in printed
    assert "attained" in printed


@pytest.mark.parametrize("sense", ["min", "max"])
def test_a_program_without_a_point_has_the_value_that_the_original_gives(sense: str) -> None:
    """Minus infinity with pinf, infinity with dinf: signs change for a maximum."""
    x, y = sp.variables(2)
    sign = -1.0 if sense == "max" else 1.0
    open_ = sp.Problem(x**3 + y, sense=sense)
    empty = sp.Problem(x, [-((x - y) ** 2) >= 1], sense=sense)
    for problem, field, value in ((open_, "pinf", -np.inf), (empty, "dinf", np.inf)):
        output = sp.sparsePOP(problem, {**QUIET, "tighten": 0})
        assert getattr(output.SDPsolverInfo, field) == 1
        assert output.POP.solverValue == sign * value


# ---- the solver ------------------------------------------------------------------------------


@pytest.mark.parametrize("tighten", [0, 1])
@pytest.mark.parametrize("name", ["SDPsolverSW", "SeDuMiSW"])
def test_sizes_without_a_solve(tighten: int, name: str) -> None:
    param = {**QUIET, "tighten": tighten, "relaxOrder": 2}
    output, solved = sp.sparsePOP(disc(), {**param, name: 0}), sp.sparsePOP(disc(), param)
    assert output.SDPobjValue is None
    assert np.isnan(output.SDPsolverInfo.pinf) and np.isnan(output.SDPsolverInfo.dinf)
    assert output.POP.xVect.size == 0
    assert output.POP.lowerBound == -np.inf
    assert output.SDPinfo.y is None
    if not tighten:
        assert output.SDPinfo.colSizeA == solved.SDPinfo.colSizeA
        assert output.SDPinfo.SDPblock == solved.SDPinfo.SDPblock
    assert output.cpuTime.SDPsolver == 0 < output.SDPinfo.rowSizeA


def test_a_coarse_tolerance_proves_less() -> None:
    param = {**QUIET, "tighten": 0, "relaxOrder": 3}
    fine = sp.sparsePOP(disc(), param)
    coarse = sp.sparsePOP(disc(), {**param, "SDPsolverEpsilon": 1e-2})
    assert coarse.SDPsolverInfo.iter < fine.SDPsolverInfo.iter
    assert coarse.SDPobjValue < fine.SDPobjValue <= -(2**0.5)


@pytest.mark.parametrize("solver", ["clarabel", "clarabel-moment", "cliquetree"])
def test_few_iterations_prove_less(solver: str) -> None:
    param = {**QUIET, "tighten": 0, "relaxOrder": 3, "SDPsolver": solver}
    few = sp.sparsePOP(disc(), {**param, "SDPsolverMaxIter": 3})
    assert few.SDPsolverInfo.iter <= 3
    assert few.SDPsolverInfo.numerr == 1
    assert few.SDPobjValue < sp.sparsePOP(disc(), param).SDPobjValue - 1e-4


# ---- outputs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("scaling", [0, 1])
def test_the_data_of_the_sdp_belong_together(scaling: int) -> None:
    """A x = b, c - A'y in K, and both objectives, in SeDuMi's form; x = Amat y1 + bVect."""
    x, y, z = sp.variables(3)
    problem = sp.Problem(
        x * y - 2 * z, [x + y + z == 4, x * z >= 1, y**2 <= 3], [0, -3, 2], [5, 3, 2]
    )
    param = {**QUIET, "tighten": 0, "relaxOrder": 2, "scalingSW": scaling}
    output = sp.sparsePOP(problem, param)
    info = output.SDPinfo
    A, b, c, K = info.SeDuMiA, info.SeDuMib, info.SeDuMic, info.SeDuMiK
    assert A.shape == (info.rowSizeA, info.colSizeA) == (b.size, c.size)
    assert info.nonzerosInA == A.nnz
    assert K["f"] == info.noOfFreevar and K["l"] == info.noOfLPvariables
    size = max(1.0, np.abs(info.x).max())
    assert np.abs(A @ info.x - b).max() < 1e-5 * size
    slack = c - A.T @ info.y
    assert np.abs(slack[: K["f"]]).max() < 1e-5 * size
    assert slack[K["f"] : K["f"] + K["l"]].min() > -1e-6 * size
    offset = K["f"] + K["l"]
    for order in K["s"].astype(int):
        block = slack[offset : offset + order**2].reshape(order, order)
        assert np.abs(block - block.T).max() < 1e-12 * size
        assert np.linalg.eigvalsh(block)[0] > -1e-6 * size
        offset += order**2
    assert c @ info.x == pytest.approx(b @ info.y, abs=1e-4 * size)
    table = info.xIdxVec.toarray()
    first = [int(np.flatnonzero((table == row).all(axis=1))[0]) for row in np.eye(3)[:2]]
    assert info.Amat @ info.y[first] + info.bVect == pytest.approx(output.POP.xVect, abs=1e-6)
    assert (info.fixedVar.tolist(), info.dimVar) == ([[3, 2]], 2)
    assert -info.objValScale * (b @ info.y) - 4 == pytest.approx(output.POP.solverValue, abs=1e-3)
    errors = output.SDPsolverInfo.err
    assert errors.shape == (6,) and np.abs(errors).max() < 1e-4
    assert output.SDPsolverInfo.r0 == np.abs(errors).max()
    assert output.SDPsolverInfo.feasratio == 1
    assert output.SDPsolverInfo.wallsec > 0


def test_first_moments_are_the_point_of_the_plain_relaxation() -> None:
    """Both signs minimise -x^2: the mean of the two is 0, which the local search does not find."""
    (x,) = sp.variables(1)
    output = sp.sparsePOP(sp.Problem(-(x**2), (), -1, 1), {**QUIET, "tighten": 0})
    assert abs(output.POP.xVect[0]) < 0.1
    assert output.POP.objValue == pytest.approx(-(output.POP.xVect[0] ** 2))
    tight = sp.sparsePOP(sp.Problem(-(x**2), (), -1, 1), QUIET)
    assert abs(tight.POP.xVect[0]) == pytest.approx(1)


def test_times_of_least_squares() -> None:
    x, y = sp.variables(2)
    parts = [sp.to_structs(sp.Problem(p))[0] for p in (x - 1, y - x**2)]
    output = sp.sparsePOP(parts, [], [-2, -2], [2, 2], QUIET)
    assert 0 <= output.cpuTime.singleObj <= output.cpuTime.readData
    assert output.POP.result.problem.squares_constant == 0
    assert -1e-6 < output.SDPobjValue <= 0
    assert sp.sparsePOP(disc(), QUIET).cpuTime.singleObj is None
