"""The linear program of a cone of denominators, against HiGHS and against naive sums."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from slow_values import slow_after

import setid
from setid.minimum_noise.attained_noise import AttainedNoise
from setid.minimum_noise.cones import linear_programs, plain_steps
from setid.minimum_noise.cones import search as cone_search
from setid.minimum_noise.cones.linear_programs import QUICK, ConeBound, ConePrograms
from setid.minimum_noise.cones.nodes import Examined
from setid.minimum_noise.cones.plain_steps import Coupled, Fixed, Sized
from setid.minimum_noise.cones.search import follow_denominators
from setid.minimum_noise.programs import Programs, longest_stretches
from setid.proofs.denominators.cones import Cone, first_cones, split_cone
from setid.proofs.denominators.denominator_cells import Cell
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.denominators.varying_multipliers import hurwitz_minors, pairs
from sparsepop_py.budget import Deadline
from sparsepop_py.executors.processes import Processes

Reals = NDArray[np.float64]
POLES = {1: [0.6], 2: [0.7 + 0.2j, 0.7 - 0.2j], 3: [0.9, 0.5 + 0.4j, 0.5 - 0.4j]}

PATIENT = QUICK._replace(patience=np.inf)


def fixed_and_point(
    random: np.random.Generator, size: int, samples: int, columns: Reals
) -> tuple[Fixed, Sized]:
    """Random data of steps, and a point inside."""
    one, two = np.triu_indices(size)
    places, shape = np.zeros((size, size), np.int64), (one.size, samples)
    places[one, two] = places[two, one] = np.arange(one.size)
    w = random.uniform(0.5, 1.5, samples)
    inside = random.uniform(1.0, 2.0, shape), random.uniform(-0.9, 0.9, shape)
    at = Sized(*inside, *random.uniform(0.1, 9.0, (2, *shape)))
    vectors, width = random.standard_normal((size, size)), size * (samples - size + 1)
    silent = np.sort(random.choice(width, width // 4, replace=False))
    columns[silent] = 0.0
    return Fixed(w / w.sum(), 3.0, vectors, places, columns, silent), at


def rows_of(
    order: int, samples: int = 30, size: float = 1.0, gaps: tuple[int, ...] = ()
) -> OutputRows:
    """A record with noise of .2 and noise bounds of ``size`` (1 + k / N) / 2 or so."""
    random = np.random.default_rng(order)
    a = np.real(np.poly(POLES[order]))
    u, x = random.uniform(-1.0, 1.0, samples), np.zeros(samples)
    for k in range(1, samples):
        past = range(1, min(k, order) + 1)
        x[k] = 2.0 * u[k - 1] - sum(a[i] * x[k - i] for i in past)
    y = x + random.uniform(-0.2, 0.2, samples)
    y[list(gaps)] = np.nan
    data = setid.IOData(u, y)
    model = setid.TransferFunction(order, 2, 1)
    found = output_rows(setid.formulate(data, model, setid.Noise(output=1.0), setid.Stable()), 0)
    assert found is not None
    return found._replace(bound=size * np.linspace(0.5, 1.5, samples))


def parts_of(cone: Cone, depth: int) -> list[Cone]:
    """Cones of several sizes: a path of halves through the first edges in turn."""
    found, edges = [cone], [pair for pair in pairs(len(cone)) if pair[0] < pair[1]]
    for step in range(depth):
        halves = split_cone(found[-1], edges[step % len(edges)], (1, 1))
        assert halves is not None
        found.append(halves[step % 2])
    return found


def naive(rows: OutputRows, programs: Programs, cone: Cone, target: float) -> float:
    """The largest t of the program's docstring, all arrays dense."""
    n, y, w = rows.order, programs.y, programs.bound
    size, count, free = n + 1, y.size, y.size - n
    every = pairs(size)
    filters = np.zeros((size, count, free))  # of v_j: (v_j * lambda)(i) = sum_l v_j[l] lambda(i+l)
    for j, i, lag in product(range(size), range(count), range(size)):
        if 0 <= i + lag - n < free:
            filters[j, i, i + lag - n] += float(cone[j][lag])
    minors = hurwitz_minors(cone, (0,) * size) if n > 2 else np.zeros((0, len(every)))
    width = size * free + len(every) * count
    unknowns = width + 1 + len(minors)
    rows_, right = [], []
    for p, (j, k) in enumerate(every):
        joined = np.zeros((count, unknowns))
        joined[:, k * free : (k + 1) * free] += filters[j]
        joined[:, j * free : (j + 1) * free] += filters[k]
        own = slice(size * free + p * count, size * free + (p + 1) * count)
        line = -(y @ joined)
        for sign in (1.0, -1.0):
            side = sign * joined
            side[:, own] -= np.eye(count)
            rows_.append(side)
            right.append(np.zeros(count))
        line[own] += target * w
        line[width], line[width + 1 :] = 1.0, minors[:, p]
        rows_.append(line[None])
        right.append(np.zeros(1))
    normal = np.zeros((1, unknowns))
    normal[0, size * free : width] = np.tile(w, len(every))
    known = np.delete(np.eye(free), programs.silent, axis=1) @ programs.known
    columns = np.kron(np.eye(size), known.T)
    heard = np.tile(~np.isin(np.arange(free), programs.silent), size)
    loose = [(None, None) if part else (0.0, 0.0) for part in heard]
    found = linprog(
        -np.eye(unknowns)[width],
        A_ub=np.vstack([*rows_, normal]),
        b_ub=np.concatenate([*right, [1.0]]),
        A_eq=np.hstack([columns, np.zeros((len(columns), unknowns - columns.shape[1]))]),
        b_eq=np.zeros(len(columns)),
        bounds=loose
        + [(None, None)] * (unknowns - len(minors) - len(loose))
        + [(0.0, None)] * len(minors),
        method="highs",
    )
    assert found.status == 0
    return float(-found.fun)


@pytest.mark.parametrize("gaps", [(), (9, 20)])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_targets_are_refuted_where_the_program_has_a_positive_value(
    order: int, gaps: tuple[int, ...]
) -> None:
    rows = rows_of(order, gaps=gaps)
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    solver, seen = ConePrograms(programs, True, effort=PATIENT), set()
    for cone in parts_of(first_cones(order, True)[0], 8)[:: 2 * order]:
        powers = (0,) * (order + 1)
        for target in (0.03, 0.1, 0.3):
            value, bound = naive(rows, programs, cone, target), solver.solve(cone, powers, target)
            # multipliers of 0 have the value 0; the search calls small values open
            if value > 2e-3 * target or value < 1e-8:
                assert (bound.factor >= target) == (value > 1e-8)
                seen.add(value > 1e-8)
    assert seen == {True, False}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_factor_is_what_the_multipliers_refute(order: int) -> None:
    """Pairs of vectors, with products of polynomials by numpy.convolve."""
    rows = rows_of(order)
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    cone = parts_of(first_cones(order, True)[0], 5)[-1]
    powers = tuple(range(order + 1))
    found = ConePrograms(programs, True, effort=PATIENT).solve(cone, powers, 0.1)
    vectors = np.array([[float(x) / 2**p for x in v] for v, p in zip(cone, powers, strict=True)])
    minors = hurwitz_minors(cone, powers) if order > 2 else np.zeros((0, len(pairs(order + 1))))
    ratios = []
    for place, (j, k) in enumerate(pairs(order + 1)):
        filtered = np.convolve(vectors[j][::-1], found.multipliers[k])
        filtered = filtered + np.convolve(vectors[k][::-1], found.multipliers[j])
        gain = filtered @ programs.y - found.minors @ minors[:, place]
        ratios.append(gain / (np.abs(filtered) @ programs.bound))
    assert found.factor == pytest.approx(min(ratios), rel=1e-6) and found.factor > 0.0
    np.testing.assert_allclose(found.multipliers @ programs.known, 0.0, atol=1e-9)
    assert np.all(found.minors >= 0.0)
    assert np.all(found.weights >= 0.0) and found.weights.sum() == pytest.approx(1.0)


def test_units_of_readings_and_noise_do_not_matter() -> None:
    rows = rows_of(2)
    cone = parts_of(first_cones(2, True)[0], 4)[-1]
    factors = []
    for unit in (1.0, 1e-6, 1e6):
        scaled = rows._replace(y=unit * rows.y, bound=unit * rows.bound)
        programs = Programs(scaled, longest_stretches(rows.row, rows.order))
        factors.append(
            ConePrograms(programs, True, effort=PATIENT).solve(cone, (0, 0, 0), 0.1).factor
        )
    np.testing.assert_allclose(factors[1:], factors[0], rtol=1e-3)


@pytest.mark.parametrize("order", slow_after(2, [1, 2, 3]))
def test_a_search_closes_from_random_denominators(order: int) -> None:
    """No denominator to begin from: the least noise is at most that of the planted one."""
    rows = rows_of(order)
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    found = follow_denominators(rows, programs, 0, 0.1, Deadline(60.0))
    assert found.cells is not None and found.cells.leaves > 0
    least = programs.solve(np.append(1.0, found.best[0]), None)
    planted = programs.solve(np.real(np.poly(POLES[order])), None)
    assert least is not None and planted is not None and least[0] <= planted[0] * (1 + 1e-9)
    assert 0.899 * least[0] <= found.factor <= least[0]
    assert found.cells.follows(rows._replace(bound=rows.bound * found.factor))


def search_of(
    rows: OutputRows, denominator: Reals, tol: float, executor: Executor | None = None
) -> cone_search._Search:
    """A search that knows one denominator."""
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    attained = AttainedNoise(programs, rows.stable)
    attained.try_denominator(denominator)
    return cone_search._Search(rows, programs, attained, tol, Deadline(60.0), executor)


def wandering() -> OutputRows:
    """Outputs that are a random walk: no model of order 3 explains them."""
    random = np.random.default_rng(1)
    data = setid.IOData(random.uniform(-1.0, 1.0, 60), np.cumsum(random.uniform(-1.0, 1.0, 60)))
    model, noise = setid.TransferFunction(3, 1, 1), setid.Noise(output=1.0)
    found = output_rows(setid.formulate(data, model, noise, setid.Stable()), 0)
    assert found is not None
    return found


def test_a_lower_target_refutes_all_cones_that_a_search_left_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = wandering()
    programs, solve, left = (
        Programs(rows, longest_stretches(rows.row, rows.order)),
        ConePrograms.solve,
        [25],
    )

    def counted(self: ConePrograms, *arguments: Any) -> ConeBound:
        left[0] -= 1
        return solve(self, *arguments)

    monkeypatch.setattr(ConePrograms, "solve", counted)
    monkeypatch.setattr(cone_search._Search, "_ended", property(lambda self: left[0] <= 0))
    search = search_of(rows, np.array([1.0, -1.0, 0.0, 0.0]), 0.02)
    before = search.run(0)
    assert search._waiting and before.factor < 0.5 * search._attained.level
    left[0] = 200
    search._reach(0.5)
    after = search._found(0)
    assert not search._waiting and left[0] > 100
    spent = left[0]
    search._reach(0.5)  # all is known: what is refuted, and what is not
    assert left[0] == spent
    assert 0.499 * search._attained.level <= after.factor < 0.9 * search._attained.level
    number = int(np.argmax(np.isfinite(search._proved) & (np.array(search._proved) > 0.1)))
    known, leaf = search._proved[number], search._leaves[number]
    nothing = np.zeros((4, programs.y.size - 3))
    less = ConeBound(0.1, nothing, np.zeros(1), np.full(10, 0.1))
    search._keep(number, Examined(search._nodes[number], None, leaf.powers, less, None, 1.0), 0.9)
    assert search._proved[number] == known and search._leaves[number] is leaf
    left[0] = 10**6
    search._reach(0.02)
    closed = search._found(0)
    assert 0.979 * search._attained.level <= closed.factor <= search._attained.level
    for found in (after, closed):
        assert found.cells is not None
        assert found.cells.follows(rows._replace(bound=rows.bound * found.factor))


def test_targets_fall_and_rise_where_the_last_one_takes_too_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows, shares = rows_of(2), list[float]()
    search = search_of(rows, np.real(np.poly(POLES[2])), 0.05)
    reach = cone_search._Search._reach

    def slow(self: cone_search._Search, share: float) -> None:
        shares.append(share)
        if len(shares) > 1:
            return reach(self, share)
        assert self._until.end < self._deadline.end
        self._until = Deadline(0.0)
        return None

    monkeypatch.setattr(cone_search._Search, "_reach", slow)
    found = search.run(0)
    assert shares == [0.05, 0.5, 0.25, 0.125, 0.05]
    assert not search._waiting and found.factor >= 0.949 * search._attained.level


@pytest.mark.parametrize(
    ("share", "spent", "left", "following"),
    [
        (0.5, 0.0, 60.0, 0.25),  # cheap: half of it
        (0.25, 9.0, 60.0, 0.25 * (9.0 / 30.0) ** (1 / 4.0)),  # for half of the time
        (0.25, 80.0, 60.0, 0.225),  # dear: a little less
        (0.07, 0.0, 60.0, 0.05),  # the tolerance is near
        (0.25, 9.0, None, 0.125),
        (0.25, 0.0, 0.0, 0.125),  # no time at all
    ],
)
def test_the_next_target_takes_a_part_of_the_time(
    share: float, spent: float, left: float | None, following: float
) -> None:
    search = search_of(rows_of(1), np.real(np.poly(POLES[1])), 0.05)
    search._deadline = Deadline(left)
    assert search._following(share, spent, 4.0) == pytest.approx(following, rel=1e-4)


def test_the_growth_is_that_of_the_last_two_targets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Targets take 0.1, 1, 32 and 64 s: brief ones tell nothing, and growth is 3.5 or more."""
    search = search_of(rows_of(2), np.real(np.poly(POLES[2])), 0.01)
    clock, spent, seen = [0.0], iter([0.0, 0.1, 1.0, 32.0, 64.0]), list[tuple[float, float]]()

    def slow(self: cone_search._Search, share: float) -> None:
        clock[0] += next(spent)
        self._until = Deadline(0.0 if not clock[0] else None)

    def halved(self: cone_search._Search, share: float, spent: float, growth: float) -> float:
        seen.append((share, growth))
        return 0.5 * share if len(seen) < 4 else 0.01

    monkeypatch.setattr(cone_search._Search, "_reach", slow)
    monkeypatch.setattr(cone_search._Search, "_following", halved)
    monkeypatch.setattr(cone_search.time, "monotonic", lambda: clock[0])
    with pytest.raises(StopIteration):
        search.run(0)
    assert [share for share, _ in seen] == [0.5, 0.25, 0.125, 0.0625]
    assert [growth for _, growth in seen] == pytest.approx([3.5, 3.5, 5.0, 3.5])


def test_what_the_last_target_refuted_is_kept_where_rising_ones_refute_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows, calls = rows_of(2), list[float]()
    search = search_of(rows, np.real(np.poly(POLES[2])), 0.05)
    reach = cone_search._Search._reach

    def once(self: cone_search._Search, share: float) -> None:
        calls.append(share)
        if len(calls) == 1:
            reach(self, share)
            self._until = Deadline(0.0)

    monkeypatch.setattr(cone_search._Search, "_reach", once)
    found = search.run(0)
    assert len(calls) > 1 and found.factor >= 0.949 * search._attained.level
    assert found.cells is not None
    assert found.cells.follows(rows._replace(bound=rows.bound * found.factor))


def test_better_denominators_lower_the_target_of_cones_in_the_queue() -> None:
    rows = rows_of(3)
    search = search_of(rows, np.real(np.poly(POLES[3])), 0.05)
    search._attained.level *= 4.0
    assert search.run(0).factor >= 0.949 * search._attained.level


@pytest.mark.parametrize("shut", [False, True])
@pytest.mark.parametrize("opened", [Processes, ThreadPoolExecutor])
def test_an_executor_solves_the_programs_of_several_cones(
    opened: Callable[[int], Executor], shut: bool
) -> None:
    """One that is shut down takes no tasks: they are solved here."""
    rows = rows_of(3)
    with opened(2) as pool:
        if shut:
            pool.shutdown()
        search = search_of(rows, np.real(np.poly(POLES[3])), 0.02, pool)
        found = search.run(0)
    assert (search._crew.cones > 1) != shut and 0.979 * search._attained.level <= found.factor
    assert found.cells is not None
    assert found.cells.follows(rows._replace(bound=rows.bound * found.factor))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_steps_are_the_same_compiled_and_by_lapack(order: int) -> None:
    """From a random point inside, for each function; the factor itself is stored differently."""
    compiled, random = linear_programs._compiled(True), np.random.default_rng(3)
    size, samples = order + 1, 40
    columns = np.zeros(((samples - order) * size, 16 * size))
    columns[:, :-3] = random.standard_normal((len(columns), 16 * size - 3))
    fixed, at = fixed_and_point(random, size, samples, columns)
    before = Sized(*random.standard_normal((4, *at.sizes.shape)))
    now, change = (Coupled(random.standard_normal(len(at.sizes)), x) for x in (0.7, -0.3))
    beside = random.standard_normal(16 * size)
    found = []
    for steps in (plain_steps, compiled):
        reduced = steps.eliminated(at, now.weights, fixed)
        half = steps.forward(0.2, at, before, now, fixed, reduced)
        whole = steps.backward(beside, half, at, change, fixed, reduced)
        after, totals = steps.advanced(at, whole[1], 0.7, 0.4, whole[0], fixed)
        assert reduced.fine
        kept = [
            value for name, value in reduced._asdict().items() if name not in ("fine", "factor")
        ]
        found.append([*kept, *half, whole[0], *whole[1], *whole[2:], *after, *totals])
    assert compiled is not plain_steps
    for plain, fast in zip(*found, strict=True):
        np.testing.assert_allclose(fast, plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())


def test_directions_solve_the_equations_of_sizes() -> None:
    """Products of slacks and duals, and dual values of sizes, as they are after the step."""
    random, aim = np.random.default_rng(5), 0.2
    fixed, at = fixed_and_point(random, 3, 20, random.standard_normal((54, 16)))
    before = Sized(*random.standard_normal((4, *at.sizes.shape)))
    now, change = (Coupled(random.standard_normal(6), x) for x in (0.7, -0.3))
    for steps in (plain_steps, linear_programs._compiled(True)):
        reduced = steps.eliminated(at, now.weights, fixed)
        half = steps.forward(aim, at, before, now, fixed, reduced)
        _, step, least, sums = steps.backward(np.ones(16), half, at, change, fixed, reduced)
        slacks, changes, products = [], [], []
        for sign, dual, turn, second in (
            (-1.0, at.above, step.above, before.above),
            (1.0, at.below, step.below, before.below),
        ):
            slack, moved = at.sizes + sign * at.filtered, step.sizes + sign * step.filtered
            twice = (before.sizes + sign * before.filtered) * second
            reached = slack * dual + moved * dual + slack * turn + twice
            np.testing.assert_allclose(reached, aim, atol=1e-8 * np.abs(slack * dual).max())
            slacks.append(np.min(moved / slack))
            changes.append(np.min(turn / dual))
            products.append([(slack * dual).sum(), (moved * dual).sum(), (slack * turn).sum()])
            products[-1].append((moved * turn).sum())
        np.testing.assert_allclose(least, [min(slacks), min(changes)], rtol=1e-9)
        np.testing.assert_allclose(sums, np.sum(products, axis=0), rtol=1e-8)
        weights, level = now.weights + change.weights, now.dual_level + change.dual_level
        wanted = (3.0 * weights[:, None] + level) * fixed.w
        after = at.above + step.above + at.below + step.below
        np.testing.assert_allclose(after, wanted, atol=1e-8 * np.abs(after).max() + 1e-8)


def test_steps_eliminate_as_dense_matrices_do() -> None:
    """The filters as a dense matrix, by numpy.convolve."""
    random, size, samples = np.random.default_rng(4), 3, 12
    one, two = np.triu_indices(size)
    rows, shape = samples - size + 1, (one.size, samples)
    known = np.zeros((rows * size, 16))
    known[:, : one.size] = random.standard_normal((rows * size, one.size))
    fixed, at = fixed_and_point(random, size, samples, known)
    vectors, w = fixed.vectors, fixed.w
    dense = np.zeros((*shape, rows, size))
    for (p, (j, k)), r in product(enumerate(zip(one, two, strict=True)), range(rows)):
        unit = np.eye(rows)[r]
        dense[p, :, r, k] += np.convolve(vectors[j][::-1], unit)
        dense[p, :, r, j] += np.convolve(vectors[k][::-1], unit)
    flat = dense.reshape(*shape, -1)
    flat[..., fixed.silent] = 0.0
    down, up = at.above / (at.sizes - at.filtered), at.below / (at.sizes + at.filtered)
    matrix = np.einsum("psi,ps,psj->ij", flat, 4.0 * down * up / (down + up), flat)
    matrix[fixed.silent, fixed.silent] = 1.0
    spread = np.einsum("psi,ps->pi", flat, w * (down - up) / (down + up))
    for steps in (plain_steps, linear_programs._compiled(True)):
        weights = np.linspace(1.0, 2.0, one.size)
        reduced = steps.eliminated(at, weights, fixed)
        right = np.column_stack([3.0 * spread.T, spread.sum(axis=0)]) + known[:, : one.size + 1]
        products = right.T @ np.linalg.solve(matrix, right)
        np.testing.assert_allclose(
            reduced.inner[: one.size + 1, : one.size + 1], products, rtol=1e-9
        )
        loss = known[:, : one.size] @ weights
        np.testing.assert_allclose(reduced.loss, loss, rtol=1e-12)
        nothing, now = Sized(*np.zeros((4, *shape))), Coupled(np.zeros(one.size), 0.0)
        half = steps.forward(0.0, at, nothing, now, fixed, reduced)
        solved = np.linalg.solve(matrix, right).T @ loss
        np.testing.assert_allclose(half.inner[: one.size + 1], solved, rtol=1e-8)
        beside = np.zeros(16)
        beside[2] = 1.0
        multipliers, step, _, _ = steps.backward(beside, half, at, now, fixed, reduced)
        wanted = -np.linalg.solve(matrix, loss + right[:, 2]).reshape(rows, size).T
        np.testing.assert_allclose(multipliers, wanted, rtol=1e-8)
        np.testing.assert_allclose(step.filtered, flat @ wanted.T.ravel(), rtol=1e-8, atol=1e-12)
        _, totals = steps.advanced(at, step, 0.0, 0.0, multipliers, fixed)
        np.testing.assert_allclose(totals.products, multipliers.T.ravel() @ known, rtol=1e-12)
        np.testing.assert_allclose(totals.noise, np.abs(at.filtered) @ w, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_factor_has_room_behind_its_last_column(order: int) -> None:
    """Elimination updates as many rows as vectors are wide, by addresses that nothing checks."""
    compiled, size, samples = linear_programs._compiled(True), order + 1, 20
    one, two = np.triu_indices(size)
    places = np.zeros((size, size), np.int64)
    places[one, two] = places[two, one] = np.arange(one.size)
    w, columns = np.full(samples, 1 / samples), np.ones(((samples - order) * size, 16))
    fixed = Fixed(w, 1.0, np.eye(size), places, columns, np.zeros(0, np.int64))
    at = Sized(
        np.ones((one.size, samples)),
        *np.zeros((1, one.size, samples)),
        *np.ones((2, one.size, samples)),
    )
    found = compiled.eliminated(at, np.ones(one.size), fixed)
    band, count = found.factor, len(columns)
    width = band.shape[1]
    assert found.fine
    assert width >= size * size and width % 8 == 0
    assert len(band) >= count - 1 + width
    assert not band[count:].any()


def test_steps_say_where_a_matrix_is_singular() -> None:
    """Vectors of zeros filter nothing."""
    fixed = Fixed(
        np.full(9, 1 / 9),
        1.0,
        np.zeros((2, 2)),
        np.array([[0, 1], [1, 2]]),
        np.zeros((16, 16)),
        np.zeros(0, np.int64),
    )
    at = Sized(np.ones((3, 9)), *np.zeros((1, 3, 9)), *np.ones((2, 3, 9)))
    for steps in (plain_steps, linear_programs._compiled(True)):
        assert not steps.eliminated(at, np.ones(3), fixed).fine


def test_plain_steps_serve_where_numba_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "setid.minimum_noise.cones.compiled_steps", None)
    monkeypatch.delattr("setid.minimum_noise.cones.compiled_steps", raising=False)
    assert linear_programs._compiled(True) is plain_steps


def test_programs_that_come_slowly_are_left() -> None:
    rows = rows_of(3)
    programs, left = Programs(rows, longest_stretches(rows.row, rows.order)), 0
    solver, patient = (ConePrograms(programs, True, effort=e) for e in (QUICK, PATIENT))
    for cone in parts_of(first_cones(3, True)[0], 8)[::2]:
        whole, early = (each.solve(cone, (0,) * 4, 0.03) for each in (patient, solver))
        assert whole.factor >= 0.03 or early.factor < 0.03
        left += early.factor < 0.03 <= whole.factor
    assert left > 0


@pytest.mark.parametrize(
    ("other", "own", "weight"), [(2.0, 0.4, 0.4), (2.0, 0.5, 0.8**0.5), (0.3, 0.4, 0.8**0.5)]
)
def test_an_edge_that_is_split_without_avail_counts_less(
    other: float, own: float, weight: float
) -> None:
    """One part is refuted and the other as hard as its whole: half of the weight of 0.8."""
    rows = rows_of(2)
    search = search_of(rows, np.real(np.poly(POLES[2])), 0.05)
    before = np.full((3, 3), 0.8)
    node = search._nodes[0]._replace(edges=before)
    search._nodes[0] = node
    search._splits[0] = Cell((1, 2), (0, 2), (1, 1))
    for _ in range(2):
        search._file(node, 0)
    search._proved[:] = [0.4 * search.target, other * search.target, own * search.target]
    found = search._edges(2)
    assert found[0, 2] == found[2, 0] == pytest.approx(weight)
    assert found[0, 1] == pytest.approx(0.8 if weight == 0.4 else weight)
    assert np.all(before == 0.8) and np.all(search._edges(0) == 0.8)


def test_nothing_is_compiled_in_a_short_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten seconds of compilation do not fit into a limit of two."""
    steps = pytest.importorskip(
        "setid.minimum_noise.cones.compiled_steps", reason="numba is an optional extra, fast"
    )
    monkeypatch.setattr(steps, "are_kept", lambda: False)
    assert linear_programs._compiled(False) is plain_steps
    assert linear_programs._compiled(True) is steps
    monkeypatch.setattr(steps, "are_kept", lambda: True)
    assert linear_programs._compiled(False) is steps
    seen: list[bool] = []
    monkeypatch.setattr(linear_programs, "_compiled", lambda anew: seen.append(anew) or plain_steps)
    monkeypatch.setattr(linear_programs, "_OFTEN", -1)
    rows = rows_of(1)
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    for limit in (2.0, 600.0, None):
        ConePrograms(programs, True, limit).solve(first_cones(1, True)[0], (0, 0), 0.1)
    assert seen == [False, True, True]


def test_what_is_compiled_returns_nothing_that_python_has_to_make() -> None:
    """For arrays and classes numba calls Python, without a look at interrupts that come there."""
    pytest.importorskip("numba", reason="numba is an optional extra, fast")
    from numba import types

    steps, rows = linear_programs._compiled(True), rows_of(1)
    programs = Programs(rows, longest_stretches(rows.row, rows.order))
    solver = ConePrograms(programs, True)
    for _ in range(linear_programs._OFTEN + 2):
        solver.solve(first_cones(1, True)[0], (0, 0), 0.1)
    for kernel in (steps._eliminated, steps._forward, steps._backward, steps._advanced):
        (made,) = kernel.nopython_signatures
        assert made.return_type in (types.none, types.boolean)


def test_machine_code_is_found_in_memory_and_on_disk(tmp_path: Path) -> None:
    """A function that is compiled with its code on disk, in a new process, and one that is not."""
    pytest.importorskip("numba", reason="numba is an optional extra, fast")
    (tmp_path / "kernels.py").write_text(
        "from sparsepop_py.solvers.cliquetree.kernels.machine import is_kept, jit\n"
        "@jit\ndef one(x):\n    return x + 1.0\n"
        "@jit\ndef other(x):\n    return x + 2.0\n"
        "print(is_kept(one), is_kept(other), one(1.0), is_kept(one), is_kept(other))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run() -> str:
        command = [sys.executable, "-c", "import kernels"]
        paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
        found = subprocess.run(
            command,
            env={**environment, "PYTHONPATH": paths},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return found.stdout.strip()

    assert run() == "False False 2.0 True False"
    assert run() == "True False 2.0 True False"
    later = time.time() + 60.0  # the source was written again
    os.utime(tmp_path / "kernels.py", (later, later))
    assert run() == "False False 2.0 True False"


def test_plain_steps_serve_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a folder for its cache numba refuses to compile."""
    machine = pytest.importorskip(
        "sparsepop_py.solvers.cliquetree.kernels.machine", reason="numba is an optional extra, fast"
    )

    def refused(function: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(machine, "jit", refused)
    monkeypatch.delitem(sys.modules, "setid.minimum_noise.cones.compiled_steps", raising=False)
    monkeypatch.delattr("setid.minimum_noise.cones.compiled_steps", raising=False)
    assert linear_programs._compiled(True) is plain_steps
