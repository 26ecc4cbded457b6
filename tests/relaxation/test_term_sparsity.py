"""Term sparsity: known blocks, properties of blocks, and the value of the whole relaxation."""

import time
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from relaxed import LOSSLESS, METHODS, dense, solved, value
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py import Problem, assemble, relax, solve_conic
from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.local_search.extraction import candidates
from sparsepop_py.problem import generators
from sparsepop_py.relaxation.blocks import block_groups
from sparsepop_py.relaxation.recover_multipliers import identity_of
from sparsepop_py.relaxation.term_sparsity import term_sparse
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Node, certify, prove
from sparsepop_py.verified.certificate.steps import Replay


def split(problem, order, method, steps=None, cliques=None, lean=False):
    """Blocks before and after, as dictionaries (free, generator, clique) -> sets of monomials."""
    cliques = cliques or dense(problem)
    system = generators.stacked(problem, np.zeros((0, 2), np.int64))
    old = block_groups(problem, cliques, order, system, (), True, lean)
    words, n = problem.objective.words, problem.dimension
    new = term_sparse(old, system, words, n, method, steps)
    return blocks_of(old), blocks_of(new)


def blocks_of(groups):
    found = {}
    for group in groups:
        for g, c, basis in zip(group.generator, group.clique, group.basis, strict=True):
            words = frozenset(tuple(w[w > 0].tolist()) for w in basis)
            found.setdefault((group.free, int(g), int(c)), []).append(words)
    return found


# ---- known blocks ------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_an_even_polynomial_splits_by_parity(method):
    """x^4 + y^4 - x^2 y^2: the classes of 1, x, y, xy."""
    x, y = sp.variables(2)
    _, new = split(Problem(x**4 + y**4 - x**2 * y**2), 2, method)
    assert set(new[False, 0, 0]) == {
        frozenset({(), (1, 1), (2, 2)}),
        frozenset({(1,)}),
        frozenset({(2,)}),
        frozenset({(1, 2)}),
    }


def test_one_symmetry_is_that_of_all_signs_together():
    """With x y in the objective only (x, y) -> (-x, -y) is left: even and odd degrees."""
    x, y = sp.variables(2)
    for method in LOSSLESS:
        _, new = split(Problem(x**4 + y**4 + x * y), 2, method)
        odd = frozenset({(1,), (2,)})
        assert set(new[False, 0, 0]) == {odd, frozenset({(), (1, 1), (1, 2), (2, 2)})}


def test_a_null_space_of_longer_vectors():
    """x y z, and x y u: the signs are s_z = s_x s_y = s_u, so z and u share a class."""
    x, y, z, u = sp.variables(4)
    problem = Problem(x * y * z + x * y * u, lower=-1, upper=1)
    _, new = split(problem, 2, "sign")
    blocks = new[False, 0, 0]
    assert frozenset({(3,), (4,), (1, 2)}) in blocks
    assert frozenset({(1,), (2, 3), (2, 4)}) in blocks
    assert frozenset({(2,), (1, 3), (1, 4)}) in blocks
    assert frozenset({(), (1, 1), (2, 2), (3, 3), (3, 4), (4, 4)}) in blocks
    assert len(blocks) == 4


def test_mirrored_inequalities_do_not_break_a_symmetry():
    """-1 <= x <= 1 by two rows, and -1 <= x + y <= 1: the latter keeps (x, y) -> (-x, -y)."""
    x, y, z = sp.variables(3)
    rows = [x + y <= 1, x + y >= -1]
    f = z**4 - x * y
    problem = Problem(f, rows, -1, 1)
    for lean in (False, True):
        _, new = split(problem, 2, "sign", lean=lean)
        words = {w: k for k, block in enumerate(new[False, 0, 0]) for w in block}
        assert words[(1,)] == words[(2,)]
        assert len({words[()], words[(1,)], words[(3,)]}) == 3
    shifted = Problem(f, [x + y <= 1, x + y >= -0.5], -1, 1)
    _, new = split(shifted, 2, "sign")
    words = {w: k for k, block in enumerate(new[False, 0, 0]) for w in block}
    assert words[()] == words[(1,)] == words[(2,)] != words[(3,)]


@pytest.mark.parametrize("lean", [False, True])
@pytest.mark.parametrize("products", [False, True])
def test_mirrored_rows_keep_the_value(lean, products):
    x, y, z = sp.variables(3)
    rows = [x + y <= 1, x + y >= -1, x - z <= 1.5, z - x <= 1.5]
    problem = Problem(x * y + y * z - 0.5 * x * z + y**2, rows, -1, 1)
    options = {"lean": lean, "products": products, "cliques": dense(problem)}
    for order in (1, 2):
        if lean and not products and order == 1:
            continue  # unbounded: no row holds a square
        whole = value(problem, order, **options)
        for method in LOSSLESS:
            found = value(problem, order, terms=method, **options)
            assert found == pytest.approx(whole, abs=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_contradicting_rows_stay_although_mirrored(method):
    """x >= 1 and x <= -1 are mirrored, and dropping both would hide that nothing is feasible."""
    x, y = sp.variables(2)
    problem = Problem(y**2, [x >= 1, x <= -1])
    relaxation = relax(problem, 1, terms=method)
    assert solve_conic(assemble(relaxation, problem.objective)).status == "infeasible"


def test_rows_that_match_nothing_leave():
    """x y = 1 with an even objective: only multipliers b with an even product stay."""
    x, y = sp.variables(2)
    problem = Problem(x**4 + y**4, [x * y == 1], -2, 2)
    old, new = split(problem, 2, "sign")
    [rows] = [b for (free, *_), b in old.items() if free]
    assert frozenset().union(*rows) == {(), (1,), (2,), (1, 1), (1, 2), (2, 2)}
    [kept] = [b for (free, *_), b in new.items() if free]
    assert frozenset().union(*kept) == {(), (1, 1), (1, 2), (2, 2)}


def test_steps_grow_to_the_stable_blocks():
    x = sp.variables(4)
    f = sp.total([v**4 for v in x]) + sp.total(
        [x[k] ** 2 * x[k + 1] for k in range(3)] + [x[0] * x[3]]
    )
    problem = Problem(f, lower=-1, upper=1)
    sizes = []
    for steps in (1, 2, 3, None):
        _, new = split(problem, 2, "chordal", steps)
        sizes.append(sum(len(b) ** 2 for b in new[False, 0, 0]))
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]


def test_wrong_arguments_are_named():
    problem = Problem(sp.variables(1)[0] ** 2)
    with pytest.raises(ProblemError, match="method: found 'blocks'"):
        relax(problem, 1, terms="blocks")
    with pytest.raises(ProblemError, match="steps: found 0"):
        split(problem, 1, "components", 0)


# ---- against the whole relaxation --------------------------------------------------------


@st.composite
def sparse_quartics(draw, even=False):
    """Random quartics of few terms in three or four variables, in a box or with rows."""
    n = draw(st.integers(3, 4))
    x = sp.variables(n)
    seed = draw(st.integers(0, 10**6))
    rng = np.random.default_rng(seed)
    f = [0.5 * v**4 for v in x]
    for _ in range(draw(st.integers(1, 4))):
        i, j, k = rng.integers(0, n, 3)
        choices = [x[i] ** 2 * x[j] ** 2, x[i] * x[j], x[i] ** 2 * x[k] ** 2]
        if not even:
            choices += [x[i] * x[j] * x[k], x[k], x[i] ** 2 * x[j] * x[k]]
        f.append(float(rng.normal()) * choices[rng.integers(len(choices))])
    rows = []
    kind = draw(st.sampled_from(["box", "ball", "sphere", "mixed"]))
    ball = 1 - sp.total([v**2 for v in x])
    if kind in ("ball", "mixed"):
        rows.append(ball >= 0)
    if kind == "sphere":
        rows.append(ball == 0)
    if kind == "mixed" and not even:
        rows.append(x[0] * x[1] + x[2] >= -0.25)
    return Problem(sp.total(f), rows, -1, 1)


@given(sparse_quartics(), st.booleans())
@settings(max_examples=15, deadline=None)
def test_components_and_signs_keep_the_value_and_chordal_is_below(problem, sparse):
    cliques = find_cliques(problem) if sparse else dense(problem)
    whole = value(problem, 2, cliques=cliques)
    for method in METHODS:
        _, solution = solved(problem, 2, cliques=cliques, terms=method)
        assert solution.dual <= whole + 1e-6
        if method in LOSSLESS:
            assert solution.dual == pytest.approx(whole, abs=2e-6)


@given(sparse_quartics(even=True))
@settings(max_examples=8, deadline=None)
def test_even_problems_have_small_blocks_and_the_same_value(problem):
    whole = relax(problem, 2, cliques=dense(problem))
    for method in LOSSLESS:
        small, solution = solved(problem, 2, cliques=dense(problem), terms=method)
        assert max(small.block_sizes) < max(whole.block_sizes)
        assert small.rows < whole.rows
        expected = solve_conic(assemble(whole, problem.objective)).dual
        assert solution.dual == pytest.approx(expected, abs=2e-6)


@given(sparse_quartics())
@settings(max_examples=10, deadline=None)
def test_no_value_exceeds_the_objective_on_a_grid(problem):
    grid = np.array(list(product(np.linspace(-1, 1, 9), repeat=problem.dimension)))
    feasible = np.ones(grid.shape[0], bool)
    for constraint, equal in zip(problem.constraints, problem.equality, strict=True):
        rest = constraint.polynomial(grid)
        feasible &= np.abs(rest) < 1e-12 if equal else rest >= 0
    for method in METHODS:
        found = value(problem, 2, terms=method)
        assert found <= problem.objective(grid[feasible]).min() + 1e-6


# ---- properties of the blocks ------------------------------------------------------------


@given(sparse_quartics(), st.sampled_from(METHODS), st.booleans(), st.booleans())
@settings(max_examples=40, deadline=None)
def test_blocks_cover_and_refine_the_old_ones(problem, method, lean, sparse):
    cliques = find_cliques(problem) if sparse else dense(problem)
    old, new = split(problem, 2, method, cliques=cliques, lean=lean)
    held = {}
    for (free, generator, _), blocks in new.items():
        held.setdefault((free, generator), set()).update(*blocks)
    for key, blocks in new.items():
        [before] = old[key] if not key[0] else [frozenset().union(*old[key])]
        assert all(block <= before for block in blocks)
        if method != "chordal" and not key[0]:
            assert sum(map(len, blocks)) == len(frozenset().union(*blocks))  # a partition
    for (free, generator, clique), blocks in old.items():
        if generator == 0:  # no monomial of a moment matrix is lost
            assert blocks[0] <= held[False, 0]
            assert not free and clique >= 0


@given(sparse_quartics(), st.booleans())
@settings(max_examples=25, deadline=None)
def test_components_refine_sign_classes_and_chordal_cliques_refine_components(problem, lean):
    table = {m: split(problem, 2, m, lean=lean)[1] for m in METHODS}
    for finer, coarser in (("components", "sign"), ("chordal", "components")):
        for key, blocks in table[finer].items():
            for block in blocks:
                assert any(block <= other for other in table[coarser].get(key, [block]))


@given(sparse_quartics(), st.sampled_from(METHODS), st.integers(0, 100))
@settings(max_examples=25, deadline=None)
def test_a_dirac_measure_satisfies_every_block(problem, method, seed):
    point = np.random.default_rng(seed).uniform(-0.4, 0.4, problem.dimension)
    if problem.equality.any():
        point /= np.linalg.norm(point)
    relaxation = relax(problem, 2, terms=method)
    y = np.append(1.0, monomials.evaluate(relaxation.moments, point))
    rows, offset = relaxation.entries @ y, 0
    system = generators.stacked(problem, relaxation.products)
    values = system.values(point)
    for group in relaxation.groups:
        for generator in group.generator:
            part = rows[offset : offset + group.rows_each]
            offset += group.rows_each
            if group.free:
                assert np.allclose(part, 0, atol=1e-12)
                continue
            matrix = np.zeros((group.size, group.size))
            i, j = group.pairs
            matrix[i, j] = matrix[j, i] = part
            if values[generator] >= 0:
                assert np.linalg.eigvalsh(matrix).min() >= -1e-12
    assert relaxation.moment_numbers(problem.objective.words).min() >= 0


@given(sparse_quartics(), st.sampled_from(LOSSLESS), st.randoms(use_true_random=False))
@settings(max_examples=20, deadline=None)
def test_relabelling_variables_relabels_the_blocks(problem, method, random):
    names = list(range(1, problem.dimension + 1))
    random.shuffle(names)
    table = np.array([0, *names], np.int32)

    def move(p):
        words = np.sort(table[p.words], axis=1)
        return Polynomial.from_words(words, p.coefficients, p.dimension)

    rows = [
        move(c.polynomial) == 0 if equal else move(c.polynomial) >= 0
        for c, equal in zip(problem.constraints, problem.equality, strict=True)
    ]
    moved = Problem(move(problem.objective), rows, -1, 1)

    def moment_blocks(p):
        # equalities drop monomials from the basis by their numbers: compare without
        system = generators.stacked(p, np.zeros((0, 2), np.int64))
        old = block_groups(p, dense(p), 2, system, (), False, False)
        return blocks_of(term_sparse(old, system, p.objective.words, p.dimension, method))

    first, second = moment_blocks(problem), moment_blocks(moved)
    named = {
        frozenset(tuple(sorted(table[list(w)].tolist())) for w in block)
        for block in first[False, 0, 0]
    }
    assert named == set(second[False, 0, 0])


# ---- the pipeline ------------------------------------------------------------------------


def test_several_objectives_share_the_support():
    x, y = sp.variables(2)
    problem = Problem(x**2 + y**2, [x**2 + y**2 <= 1], -1, 1)
    relaxation = relax(problem, 2, objectives=[x, x * y], terms="components")
    for f, expected in ((problem.objective, 0), (x, -1), (x * y, -0.5)):
        assert solve_conic(assemble(relaxation, f)).dual == pytest.approx(expected, abs=1e-5)
    with pytest.raises(ProblemError, match="is not among the moments"):
        relax(problem, 2, terms="components").objective_vector(x)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("lean", [False, True])
def test_small_blocks_prove_the_bound(method, lean):
    """A certificate from the small blocks holds what the solver found; x y = -1/2 is feasible."""
    x, y, z = sp.variables(3)
    problem = Problem(x * y + x**2 * z**2 - 0.5 * y * z**2 * x, [x**2 + y**2 <= 1], -1, 1)
    relaxation, solution = solved(problem, 2, terms=method, lean=lean, products=True)
    box = Interval(problem.lower, problem.upper)
    scaled = Scaled.of(problem, Scaling.of_box(box), (problem.objective,))
    identity = identity_of(relaxation, scaled, solution.z, 1.0)
    replay = Replay(problem, None)
    proved = prove(replay, box, identity, False)
    certificate = certify(replay, Node(argument=identity), proved)
    assert certificate.bound == pytest.approx(solution.dual, abs=1e-6)
    assert certificate.verify(problem).ok
    assert certificate.bound <= -0.5


def test_candidates_come_from_blocks_with_the_constant():
    """min (x - 1/2)^2 + y^4 - y^2/2: x is known, of y = +-1/2 the square, and so its root."""
    x, y = sp.variables(2)
    f = (x - 0.5) ** 2 + y**4 - 0.5 * y**2
    problem = Problem(f, lower=-1, upper=1)
    for method in METHODS:
        relaxation, solution = solved(problem, 2, terms=method, cliques=dense(problem))
        [point, *_] = candidates(relaxation, solution.y)
        assert point[0] == pytest.approx(0.5, abs=1e-3)
        assert point[1] == pytest.approx(0.5, abs=1e-3)


def test_an_even_problem_has_a_minimiser_among_its_candidates():
    """Four of them, (+-1, +-1) / sqrt 2."""
    x, y = sp.variables(2)
    problem = Problem(x**4 + y**4 - x**2 - y**2, lower=-1, upper=1)
    relaxation, solution = solved(problem, 2, terms="sign")
    (point,) = candidates(relaxation, solution.y)
    assert np.abs(point) == pytest.approx(np.sqrt([0.5, 0.5]), abs=1e-3)


@pytest.mark.parametrize("method", slow_after(1, METHODS))
def test_a_thousand_cliques_are_split_quickly(method):
    """Every clique (x_k, x_k+1) with x_k x_k+1 has classes {1, squares, product} and the rest."""
    x = sp.variables(1001)
    coefficient = np.random.default_rng(3).normal(size=1000)
    terms = [a * x[k] * x[k + 1] + x[k] ** 4 for k, a in enumerate(coefficient)]
    problem = Problem(sp.total(terms), lower=-1, upper=1)
    cliques = find_cliques(problem)
    assert len(cliques) == 1000
    start = time.process_time()
    relaxation = relax(problem, 2, cliques=cliques, terms=method)
    assert time.process_time() - start < 1.0
    assert max(relaxation.block_sizes) == 4
    assert relaxation.rows < relax(problem, 2, cliques=cliques).rows
