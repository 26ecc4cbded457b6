"""Rays: every one that is found is followed here in rationals, and none is found in vain."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import value_at

import sparsepop_py as sp
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.verified.points import unbounded_ray
from sparsepop_py.verified.points.unbounded_ray import falling_ray


def follow(problem, start, ray):
    """Feasible at every step of 2^k, and the objective falls below every mark."""
    lowest = value_at(problem.objective, [Fraction(v) for v in start.x.tolist()])
    for k in range(0, 41, 4):
        step = Fraction(2) ** k
        point = [
            Fraction(a) + step * Fraction(d) for a, d in zip(start.x.tolist(), ray, strict=True)
        ]
        for v, low, high in zip(point, problem.lower, problem.upper, strict=True):
            assert (low == -np.inf or v >= Fraction(float(low))) and (
                high == np.inf or v <= Fraction(float(high))
            )
        for constraint in problem.constraints:
            value = value_at(constraint.polynomial, point)
            assert value == 0 if constraint.kind is sp.Kind.ZERO else value >= 0
        lowest = min(lowest, value_at(problem.objective, point))
    assert lowest <= -(10**6)


UNBOUNDED = {
    "line": "min x",
    "parabola": "min -x^2",
    "cubic": "min x^3",
    "edge": "min x1+x2; s.t. x1-x2==0",
    "quadrant": "min -x1*x2; s.t. x1>=0; x2>=1",
    "hyperbola": "min -x1; s.t. x1*x2>=1; x2-0.5>=0",
    "saddle": "min x1*x2; s.t. x1>=1",
    "far start": "min -x1-x2^3; s.t. x1+x2>=7; x2>=0; x1>=0",
}


@pytest.mark.parametrize("effort", ["presolve", "plain"])
@pytest.mark.parametrize("name", UNBOUNDED)
def test_unbounded_problems_get_a_status_and_no_number(name, effort):
    problem = sp.parse(UNBOUNDED[name])
    result = sp.solve(problem, sp.Options(effort=effort))
    assert result.status is sp.Status.UNBOUNDED
    assert result.lower_bound == -np.inf
    assert result.upper_bound == -np.inf
    assert result.certificate is None
    assert not np.isfinite(result.gap)
    follow(problem, result.attained, result.ray)
    moving = [name for name, v in zip(problem.names, result.ray, strict=True) if v]
    assert "ray" in result.message and all(f"{name} by" in result.message for name in moving)
    assert result.message in result.summary()
    assert problem.violation(result.x) == 0.0


@pytest.mark.parametrize(
    "text",
    [
        "min x; s.t. x+5>=0",
        "min x^2-4*x",
        "min -x1; s.t. 1-x1^2-x2^2>=0",
        "min x1; s.t. x1-x2==0; x2>=0",
        "min -x1*x2; s.t. x1==0",
        "min x1^4-x1^3",
    ],
)
def test_bounded_problems_have_no_ray(text):
    problem = sp.parse(text)
    for x in ([0.0, 0.0], [1.0, 1.0], [0.5, 0.5], [-3.0, 2.0], [0.0, 4.0]):
        start = prove_feasible(problem, np.array(x[: problem.dimension]))
        if start is not None:
            assert falling_ray(problem, start) is None
    assert sp.solve(problem).status is not sp.Status.UNBOUNDED


def test_a_ray_needs_a_point_that_is_feasible_itself():
    x, y = sp.variables(2)
    problem = sp.Problem(y, [x**2 == 2])
    start = prove_feasible(problem, np.array([np.sqrt(2), 0.0]))
    assert start.proof == "krawczyk"
    assert falling_ray(problem, start) is None  # it falls, but sqrt(2) is no double


def test_an_unbounded_problem_without_an_exact_point_gets_no_number():
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem(y, [x**2 == 2]))
    assert result.lower_bound == -np.inf
    assert result.status is sp.Status.UNPROVED


def test_bounds_stop_a_ray():
    x, y = sp.variables(2)
    start = prove_feasible(sp.Problem(x + y, lower=[-9, -9]), np.zeros(2))
    assert falling_ray(sp.Problem(x + y, lower=[-9, -9]), start) is None
    ray = falling_ray(sp.Problem(x + y, lower=[-9, -np.inf]), start)
    assert ray[0] >= 0
    assert ray[1] < 0


@pytest.mark.parametrize("seed", range(20))
def test_random_cones(seed):
    """Linear objectives over cones A x >= 0 with known generators: a ray, or a proved bound 0."""
    rng = np.random.default_rng(seed)
    x = sp.variables(2)
    angle, width = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 2.5)
    normals = [
        np.round(64 * np.array([-np.sin(angle), np.cos(angle)])),
        np.round(64 * np.array([np.sin(angle + width), -np.cos(angle + width)])),
    ]
    rows = [float(a) * x[0] + float(b) * x[1] >= 0 for a, b in normals]
    cost = np.round(8 * rng.normal(size=2))
    f = float(cost[0]) * x[0] + float(cost[1]) * x[1]
    problem = sp.Problem(f, rows)
    edges = [np.array([n[1], -n[0]]) for n in normals]
    edges = [e for e in edges + [-e for e in edges] if all(n @ e >= 0 for n in normals)]
    falls = any(cost @ e < 0 for e in edges)
    start = prove_feasible(problem, np.zeros(2))
    ray = falling_ray(problem, start)
    if ray is not None:
        assert falls
        follow(problem, start, ray)
    result = sp.solve(problem)
    if falls:
        assert result.lower_bound == -np.inf
    else:
        assert result.status is not sp.Status.UNBOUNDED
        assert result.lower_bound <= 0.0 <= result.upper_bound


def test_rays_that_leave_a_ball_are_not_followed_in_rationals(monkeypatch):
    """x1 x2 + x3 falls along several axes, each of which soon leaves the ball."""
    x = sp.variables(3)
    problem = sp.Problem(x[0] * x[1] + x[2] - x[0], [sp.total(v * v for v in x) <= 4])
    start = prove_feasible(problem, np.zeros(3))
    monkeypatch.setattr(unbounded_ray, "_along", lambda *_: pytest.fail("followed"))
    assert start.proof == "exact" and falling_ray(problem, start) is None
