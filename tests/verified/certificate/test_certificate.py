"""Certificates: what is true verifies without a solver, what is damaged is refused."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_certificates import (
    INF,
    KNOWN,
    chain,
    check,
    circle,
    empty,
    hill,
    known_results,
    last_bit,
    with_multipliers,
    with_root,
)

import sparsepop_py as sp
from sparsepop_py import solvers
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.relaxation.recover_multipliers import shortened
from sparsepop_py.solvers import clarabel_
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Node, certify, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay

ROOT = Path(sp.__file__).resolve().parent


made = pytest.mark.parametrize("make", KNOWN, ids=lambda make: make.__name__)


@pytest.fixture
def results():
    return known_results()


# ---- true claims ------------------------------------------------------------------------------


@made
def test_a_true_claim_verifies_on_an_equal_problem(results, make):
    result = results[make]
    assert result.lower_bound <= KNOWN[make]
    if np.isfinite(KNOWN[make]):
        assert result.lower_bound >= KNOWN[make] - 1e-5
    verdict = result.certificate.verify(make())
    assert verdict.ok
    assert verdict.reason == ""
    assert verdict.bound >= result.lower_bound
    assert result.certificate.fingerprint == make().fingerprint


@made
def test_verification_needs_no_solver(results, make, monkeypatch):
    def refuse(*_args, **_settings):
        raise AssertionError("a solver was called")

    monkeypatch.setattr(solvers, "solve_conic", refuse)
    monkeypatch.setattr(relaxation_bound, "solve_conic", refuse)
    for name in ("squares_form", "moment_form"):
        monkeypatch.setattr(clarabel_, name, refuse)
    monkeypatch.setattr("scipy.optimize.linprog", refuse)
    monkeypatch.setattr("scipy.optimize.minimize", refuse)
    assert results[make].certificate.verify(make()).ok


def test_verification_runs_where_clarabel_cannot_be_imported(results, tmp_path):
    """In a fresh process, from files, with every solver package blocked."""
    pairs = [(make(), results[make].certificate) for make in KNOWN]
    (tmp_path / "pairs.pickle").write_bytes(pickle.dumps(pairs))
    script = f"""
import importlib.abc, pickle, sys, types

class Block(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("clarabel", "cvxpy", "highspy", "scs", "casadi"):
            raise ImportError("blocked: " + name)

sys.meta_path.insert(0, Block())
try:
    import clarabel
except ImportError:
    pass
else:
    raise SystemExit("clarabel is not blocked")
package = types.ModuleType("sparsepop_py")  # its __init__ would import the solvers
package.__path__ = [{str(ROOT)!r}]
sys.modules["sparsepop_py"] = package
with open({str(tmp_path / "pairs.pickle")!r}, "rb") as file:
    pairs = pickle.load(file)
for problem, certificate in pairs:
    verdict = certificate.verify(problem)
    print(verdict.ok, repr(float(verdict.bound)))
assert not any(name.startswith("sparsepop_py.solvers") for name in sys.modules)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.split("\n")[: len(pairs)]
    for line, (problem, certificate) in zip(lines, pairs, strict=True):
        ok, bound = line.split()
        assert ok == "True"
        assert float(bound) == certificate.verify(problem).bound


@made
def test_verification_does_not_change_certificate_or_problem(results, make):
    certificate, problem = results[make].certificate, make()
    before = pickle.dumps(certificate), problem.fingerprint
    first, second = certificate.verify(problem), certificate.verify(problem)
    assert first == second
    assert (pickle.dumps(certificate), problem.fingerprint) == before


# ---- refused exactly when less is proved than claimed -----------------------------------------


@pytest.mark.parametrize("make", [make for make in KNOWN if make is not empty])
def test_a_claim_one_ulp_above_is_refused(results, make):
    certificate, problem = results[make].certificate, make()
    recomputed = certificate.verify(problem).bound
    assert replace(certificate, bound=recomputed).verify(problem).ok
    above = replace(certificate, bound=float(np.nextafter(recomputed, INF))).verify(problem)
    assert not above.ok
    assert above.bound == recomputed
    assert "less than what is claimed" in above.reason
    assert replace(certificate, bound=float(np.nextafter(recomputed, -INF))).verify(problem).ok
    assert not replace(certificate, bound=np.nan).verify(problem).ok
    assert not replace(certificate, bound=INF).verify(problem).ok


@pytest.mark.parametrize(
    "where",
    ["objective", "constraint", "kind", "lower", "upper", "row added", "row dropped"],
)
@made
def test_another_problem_is_refused_even_in_the_last_bit(results, make, where):
    problem = make()
    if where in ("constraint", "kind", "row dropped") and not problem.constraints:
        where = "objective"
    other = last_bit(problem, where)
    verdict = results[make].certificate.verify(other)
    assert not verdict.ok
    assert verdict.bound == -INF
    assert "another problem" in verdict.reason


def test_names_and_memos_are_not_part_of_the_claim(results):
    problem = circle()
    renamed = sp.Problem(
        problem.objective,
        problem.constraints,
        problem.lower,
        problem.upper,
        ["u", "v"],
        sense="max",
    )
    assert results[circle].certificate.verify(renamed).ok


@pytest.mark.parametrize("size", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3])
@made
def test_perturbed_multipliers_lower_the_bound_or_are_refused(results, make, size):
    certificate, problem = results[make].certificate, make()
    assert certificate.identity is not None
    rng = np.random.default_rng(int(-np.log10(size)) + 20)
    noisy = with_multipliers(
        certificate, lambda g: replace(g, values=g.values + size * rng.normal(size=g.values.shape))
    )
    verdict = check(noisy, problem, KNOWN[make])
    if size >= 1.0:
        assert not verdict.ok


@made
def test_rounded_and_missing_multipliers(results, make):
    certificate, problem = results[make].certificate, make()
    rounded = with_multipliers(certificate, lambda g: replace(g, values=g.values.astype("f4")))
    check(rounded, problem, KNOWN[make])
    none = with_root(certificate, argument=replace(certificate.identity, multipliers=()))
    assert not check(none, problem, KNOWN[make]).ok
    nothing = with_root(certificate, argument=None)
    assert not check(nothing, problem, KNOWN[make]).ok
    bad = with_multipliers(certificate, lambda g: replace(g, values=g.values * np.nan))
    verdict = check(bad, problem, KNOWN[make])
    assert not verdict.ok
    assert "not finite" in verdict.reason


@made
def test_multipliers_of_other_constraints_are_refused(results, make):
    certificate, problem = results[make].certificate, make()

    def swapped(group):
        return replace(group, generator=np.where(group.generator == 0, 1, 0 * group.generator))

    if problem.constraints:
        assert not check(with_multipliers(certificate, swapped), problem, KNOWN[make]).ok
    far = with_multipliers(certificate, lambda g: replace(g, generator=g.generator + 10**6))
    verdict = check(far, problem, KNOWN[make])
    assert not verdict.ok
    assert "does not exist" in verdict.reason


@made
def test_a_changed_scaling_is_refused_or_still_sound(results, make):
    certificate, problem = results[make].certificate, make()
    scaling = certificate.identity.scaling

    def rescaled(**fields):
        changed = replace(scaling, **fields)
        identity = replace(certificate.identity, scaling=changed)
        return check(with_root(certificate, argument=identity), problem, KNOWN[make])

    shrunk = rescaled(scale=scaling.scale * 0.99)
    if scaling.boxed.all():
        assert not shrunk.ok
        assert "larger than the multipliers assume" in shrunk.reason
    assert not rescaled(scale=scaling.scale * 1.01).ok  # the identity no longer fits
    assert not rescaled(centre=scaling.centre + 0.01 * scaling.scale).ok
    assert not rescaled(scale=-scaling.scale).ok
    assert not rescaled(scale=0.0 * scaling.scale).ok
    assert not rescaled(scale=np.full_like(scaling.scale, np.nan)).ok
    if not scaling.boxed.all():
        assert not rescaled(boxed=np.ones_like(scaling.boxed)).ok


@pytest.mark.parametrize("shift", [-1e6, -1.0, -1e-3, -1e-9, 1e-9, 1e-3, 1.0, 1e6])
def test_a_cutoff_is_an_upper_limit_of_the_claim_wherever_it_lies(results, shift):
    for make in (circle, hill):
        certificate, problem = results[make].certificate, make()
        assert certificate.box.uses_cutoff
        cutoff = KNOWN[make] + shift
        moved = replace(certificate, cutoff=cutoff)
        verdict = check(moved, problem, KNOWN[make])
        assert verdict.bound <= cutoff
        assert not verdict.ok or shift > -1e-3  # the cutoff itself is below the claim
        greedy = replace(moved, bound=min(cutoff, KNOWN[make]) + 1e-9)
        assert not check(greedy, problem, KNOWN[make]).ok
        assert not check(replace(moved, bound=INF), problem, KNOWN[make]).ok
        assert not check(replace(certificate, cutoff=None), problem, KNOWN[make]).ok


@pytest.mark.parametrize("cutoff", [np.nan, INF, -INF])
def test_a_cutoff_that_is_no_number_proves_nothing(results, cutoff):
    for make in (circle, hill):
        verdict = replace(results[make].certificate, cutoff=cutoff).verify(make())
        assert not verdict.ok
        assert verdict.bound == -INF
        assert "not a number" in verdict.reason


def test_box_steps_are_replayed_not_believed(results):
    for make in (circle, hill, chain):
        certificate, problem = results[make].certificate, make()
        assert certificate.box.steps
        bare = check(with_root(certificate, box=BoxProof()), problem, KNOWN[make])
        assert make is chain or not bare.ok  # the box of the chain is that of its bounds
        for k in range(len(certificate.box.steps)):
            steps = certificate.box.steps[:k] + certificate.box.steps[k + 1 :]
            check(with_root(certificate, box=BoxProof(steps)), problem, KNOWN[make])
        fewer = tuple(
            replace(s, sweeps=0) if isinstance(s, Propagation) else s for s in certificate.box.steps
        )
        check(with_root(certificate, box=BoxProof(fewer)), problem, KNOWN[make])


def test_a_node_that_is_falsely_said_to_be_empty_keeps_what_its_box_proves():
    """min x + y over [1, 2] x [0, 1] is 1."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x * y >= 0], lower=[1, 0], upper=[2, 1])
    honest = sp.solve(problem).certificate
    root = replace(honest.root, empty=True)
    verdict = replace(honest, bound=INF, root=root).verify(problem)
    assert not verdict.ok
    assert verdict.bound == pytest.approx(1.0, abs=1e-12) and verdict.bound <= 1.0
    assert replace(honest, bound=verdict.bound, root=root).verify(problem).ok


def test_multipliers_beyond_short_floats_stay_long():
    """min x y over the unit disc is -1/2; the box around it says at least -1."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1], lower=-1, upper=1)
    identity = sp.solve(problem).certificate.identity
    halves = tuple(replace(m, values=m.values * 1e60) for m in identity.multipliers)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        short = shortened(replace(identity, multipliers=halves))
        found = prove(Replay(problem, None), Interval(problem.lower, problem.upper), short, False)
    assert all(np.isfinite(m.values).all() for m in short.multipliers)
    assert -1.0 - 1e-12 <= found.bound <= -0.5


@pytest.mark.parametrize("cutoff", [-3.0, -1e-12, -1e-200])
def test_an_empty_box_after_a_cutoff_proves_the_cutoff_and_nothing_more(cutoff):
    """min x + y over the unit box is 0: no point lies below a negative cutoff."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, lower=0, upper=1)
    root, replay = Node(BoxProof((Propagation(2, True),))), Replay(problem, cutoff)
    box = root.box.replay(replay)
    assert np.any(box.lo > box.hi)
    honest = certify(replay, root, prove(replay, box, None, False))
    assert honest.bound == cutoff
    assert honest.verify(problem).ok
    for claim in (float(np.nextafter(cutoff, INF)), 0.0, 1.0, INF):
        verdict = replace(honest, bound=claim).verify(problem)
        assert not verdict.ok
        assert verdict.bound == cutoff
    # for another objective over the same set the cutoff means something else
    above = sp.Problem(x + y - 4, lower=0, upper=1)
    assert Certificate(above.fingerprint, INF, root, cutoff).verify(above).bound <= -4.0


def test_verdicts_are_true_where_claims_hold() -> None:
    """A tuple of three items is true by itself: a forged certificate must not look so."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 <= 1])
    certificate = sp.solve(problem).certificate
    assert certificate.verify(problem)
    forged = replace(certificate, bound=certificate.bound + 1000.0)
    assert not forged.verify(problem) and not forged.verify(problem).ok
    ratio = sp.RationalProblem(x / (1 + y**2), [x**2 + y**2 <= 1])
    found = sp.solve(ratio).certificate
    assert found.verify(ratio) and not replace(found, bound=1000.0).verify(ratio)
    line = sp.Problem(x, (), [0, 0], [1, 1])
    (bound,) = sp.linear_bounds(line, [x])
    assert bound.verify(line, x) and not bound.verify(line, x + y)
