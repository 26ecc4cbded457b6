"""Local searches: they only suggest points, and say what is missing."""

import sys
import time

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial import total
from sparsepop_py.budget import spent
from sparsepop_py.local_search import multistart, solvers
from sparsepop_py.local_search.multistart import starting_points
from sparsepop_py.local_search.solvers import local_search
from sparsepop_py.verified.arithmetic.interval import Interval


def test_a_missing_ipopt_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(sp.SolverNotFound, match=r"sparsepop-py\[ipopt\]"):
        sp.solve(sp.problems.laboratory(), sp.Options(order=2, refine="ipopt"))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_ipopt_attains_the_laboratory_minimum():
    pytest.importorskip("casadi", reason="casadi, which brings IPOPT, is an optional extra")
    result = sp.solve(sp.problems.laboratory(), sp.Options(order=2, refine="ipopt"))
    assert result.attained is not None
    assert result.upper_bound == pytest.approx(52.7066065447, abs=1e-6)


class _Quick:
    """What is used of casadi, with a search that remembers its settings and returns its start."""

    MX = type("MX", (float,), {"sym": staticmethod(lambda name, size: [1.0] * size)})
    vertcat = staticmethod(lambda *rows: rows)

    def __init__(self):
        self.asked = []

    def nlpsol(self, name, kind, data, settings):
        self.asked.append(settings)
        return lambda x0, **bounds: {"x": x0}


@pytest.mark.parametrize("seconds, most", [(np.inf, None), (5.0, 5.0), (-1.0, 1e-3)])
def test_ipopt_is_given_the_time_that_is_left(seconds, most, monkeypatch):
    casadi, x = _Quick(), sp.variables(2)
    monkeypatch.setitem(sys.modules, "casadi", casadi)
    problem = sp.Problem(x[0] ** 2 + x[1], [x[0] >= x[1]], lower=-1, upper=1)
    local_search(problem, np.zeros(2), "ipopt", time.monotonic() + seconds)
    (settings,) = casadi.asked
    given = settings.get("ipopt.max_wall_time")
    assert given is None if most is None else 0.0 < given <= most


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_ipopt_ends_with_the_time():
    """A chain of 2000 variables takes IPOPT thousands of iterations."""
    pytest.importorskip("casadi", reason="casadi, which brings IPOPT, is an optional extra")
    x = sp.variables(2000)
    steps = [(1 - a) ** 2 + 100 * (b - a**2) ** 2 for a, b in zip(x, x[1:], strict=False)]
    problem, start = sp.Problem(total(steps)), np.full(2000, -1.2)
    begun = time.monotonic()
    found = local_search(problem, start, "ipopt", begun + 0.05)
    assert 1.0 < problem.objective(found) <= problem.objective(start)


@pytest.mark.parametrize("start", [[-1.2, 1.0], [3.0, -2.0]])
def test_searches_without_rows_end_at_the_stationary_point(start):
    """(1 - x)^2 + 100 (y - x^2)^2 has the only stationary point (1, 1)."""
    x, y = sp.variables(2)
    problem = sp.Problem((1 - x) ** 2 + 100 * (y - x**2) ** 2)
    assert local_search(problem, np.array(start)) == pytest.approx([1.0, 1.0], abs=1e-8)


def test_starting_points_lie_in_the_box_and_repeat():
    problem = sp.Problem(total(sp.variables(3)))
    box = Interval(np.array([-1.0, 2.0, -np.inf]), np.array([1.0, np.inf, -5.0]))
    points = starting_points(problem, box, 9, seed=3)
    assert len(points) == 10
    assert all(np.all((box.lo <= p) & (p <= box.hi)) for p in points)
    again = starting_points(problem, box, 9, seed=3)
    assert all(np.array_equal(p, q) for p, q in zip(points, again, strict=True))


def test_every_other_starting_point_of_a_wide_box_is_near_0_or_the_nearest_bound():
    problem = sp.Problem(total(sp.variables(2)), [sp.variables(2)[0] == 1])
    box = Interval(np.array([-1e6, 300.0]), np.array([1e6, 1e6]))
    points = starting_points(problem, box, 9, seed=3)
    assert all(np.all((box.lo <= p) & (p <= box.hi)) for p in points)
    assert all(np.max(np.abs(p - [0.0, 300.0])) <= 50.0 for p in points[1::2])
    assert any(np.max(np.abs(p)) > 1e3 for p in points[2::2])


@pytest.mark.parametrize("end, count", [(np.inf, 3), (0.0, 1)])
def test_one_proof_of_existence_is_tried_when_time_is_over(end, count, monkeypatch):
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=-1.0, upper=1.0)
    tried = []
    monkeypatch.setattr(multistart, "prove_feasible", lambda *given: tried.append(given))
    found = [(value, np.array([value])) for value in (0.1, 0.2, 0.3)]
    multistart._best_proved(problem, found, None, multistart.Aim(1e-6), end)
    assert len(tried) == count


def test_large_problems_are_searched_without_full_matrices(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sum of x_i over x_i x_(i+1) >= 1/4 in pairs is least where all x_i are 1/2."""
    count = 2002
    x = sp.variables(count)
    rows = [x[i] * x[i + 1] >= 0.25 for i in range(0, count, 2)]
    problem = sp.Problem(total(x), rows, lower=0.1, upper=1)
    monkeypatch.setattr(solvers, "minimize", None)
    found = local_search(problem, np.full(count, 0.8))
    assert found.sum() == pytest.approx(count / 2, abs=1e-3)


def test_dense_factorizations_of_slsqp_count_as_work():
    """At 120 variables its steps took seconds, of which a hundredth was counted."""
    n = 100
    x = sp.variables(n)
    problem = sp.Problem(total(x), [total(v * v for v in x) <= n])  # the least value is -n
    before = spent()
    found = local_search(problem, np.full(n, 0.5))
    assert spent() - before > 2e-9 * n**3  # two steps at least
    assert found == pytest.approx(np.full(n, -1.0), abs=1e-4)
