"""Relaxations that fit into memory and time.

An interior-point step costs about sum r^3 / 3 + sum c^3 / 3 operations and 8 sum r^2 bytes,
r being the number s (s + 1) / 2 of entries of each semidefinite block and c the number of
moments of each clique. Building takes memory for the products of the largest clique's
monomials, words as long as their degree. The lean form of a relaxation often gives the same
bound at a tenth of that, so it goes first, and stays alone where the full form is too large.
Where even it does not fit and there is one clique, the clique-tree method is left, which takes
about sum r^2 operations in place of sum r^3 / 3. Where that is too long, too, the order is lowered.
Each change is noted; every bound stays proved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import comb

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.budget import TOO_LARGE
from sparsepop_py.errors import ProblemError
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.basis import MOST_BYTES, building_bytes
from sparsepop_py.relaxation.moment import Relaxation, least_order, relax
from sparsepop_py.relaxation.sparsepop.relaxation import plain_relaxation
from sparsepop_py.sparsity.correlative import Cliques

__all__ = [
    "LARGEST_DEGREE",
    "LEAN",
    "affordable",
    "check_degrees",
    "fitting_relaxations",
    "largest_basis",
    "solved_by_moments_alone",
    "solver_bytes",
    "worth_building",
]

LEAN = "bounds enter linearly"  # how the note begins where only the lean form fits
_OPERATIONS = 4e10  # a step; above, a relaxation is not tried
_ALONE, _PER_PAIR = 1.5e11, 30.0  # the same by the clique-tree method; for two entries of a block
_TINY = 1e5  # a step; below, the full form takes no time
_A_SECOND = 3e9  # operations of one of some twenty steps for each second that is left
_BY_MOMENTS = ("auto", "cliquetree")  # choices of a solver
_BASIS = 1500  # monomials of one clique; above, a relaxation is not even built
LARGEST_DEGREE = 2000  # of a problem; above, arithmetic with its powers has no end in sight


Fitting = tuple[tuple[Relaxation, ...], tuple[str, ...]]  # what is to be tried, and notes
_NOTHING: Fitting = ((), ())


def solver_bytes(relaxation: Relaxation) -> float:
    """Estimate the memory in bytes that an interior-point solver needs for the blocks."""
    return float(sum(12.0 * _entries(s) ** 2 * k for s, k in relaxation.block_sizes.items()))


def check_degrees(problem: Problem, objectives: Sequence[Polynomial] = ()) -> None:
    """Check before any work that no degree is too large.

    Raises
    ------
    ProblemError
        If one is above ``LARGEST_DEGREE``; the message names the polynomial.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> check_degrees(sp.Problem(x, [x**5000 <= 1]))
    Traceback (most recent call last):
    ...
    sparsepop_py.errors.ProblemError: constraints[0]: found degree 5000, expected at most 2000
    """
    if max(problem.degree, 0, *(f.degree for f in objectives)) <= LARGEST_DEGREE:
        return
    named = [("objective", problem.objective.degree)]
    named += [(f"objectives[{k}]", f.degree) for k, f in enumerate(objectives)]
    named += [(f"constraints[{k}]", c.degree) for k, c in enumerate(problem.constraints)]
    for name, degree in named:
        if degree > LARGEST_DEGREE:
            raise ProblemError(f"{name}: found degree {degree}, expected at most {LARGEST_DEGREE}")


def worth_building(problem: Problem, cliques: Cliques, order: int, memory: float) -> bool:
    """Check that the basis of the largest clique is small enough to build the relaxation."""
    small = largest_basis(cliques, order) <= _BASIS
    return small and building_bytes(problem, cliques, order) <= min(memory, MOST_BYTES)


def largest_basis(cliques: Cliques, order: int) -> int:
    """Count the monomials of the largest clique up to a degree."""
    return comb(max(len(c) for c in cliques.members) + order, order)


def affordable(relaxation: Relaxation, memory: float) -> bool:
    """Check that a solver has memory for a relaxation and time for a step."""
    return _operations(relaxation) <= _OPERATIONS and solver_bytes(relaxation) <= memory


def solved_by_moments_alone(relaxation: Relaxation) -> bool:
    """Check that only a solver whose unknowns are the moments has time for a step."""
    return _block_operations(relaxation) > _OPERATIONS


def _entries(size: int) -> float:
    return size * (size + 1) / 2.0


def _operations(relaxation: Relaxation) -> float:
    """Count operations of one interior-point step, for blocks and moments of each clique."""
    return _block_operations(relaxation) + _moment_operations(relaxation)


def _block_operations(relaxation: Relaxation) -> float:
    return sum(_entries(s) ** 3 * k / 3.0 for s, k in relaxation.block_sizes.items())


def _clique_tree_operations(relaxation: Relaxation) -> float:
    """Count operations of a step of the clique-tree method, whose unknowns are the moments."""
    blocks = sum(_PER_PAIR * _entries(s) ** 2 * k for s, k in relaxation.block_sizes.items())
    return blocks + _moment_operations(relaxation)


def _moment_operations(relaxation: Relaxation) -> float:
    clique = np.concatenate([np.repeat(g.clique, g.rows_each) for g in relaxation.groups])
    columns = relaxation.entries.indices.astype(np.int64)
    row = np.repeat(np.arange(relaxation.rows), np.diff(relaxation.entries.indptr))
    pairs = monomials.distinct(clique[row] * (relaxation.moments.shape[0] + 1) + columns)
    moments = np.bincount(pairs // (relaxation.moments.shape[0] + 1))
    return float(np.sum(moments.astype(float) ** 3) / 3.0)


def fitting_relaxations(
    problem: Problem,
    cliques: Cliques,
    objectives: Sequence[Polynomial],
    options: Options,
    *,
    constrained: bool,
) -> tuple[tuple[Relaxation, ...], tuple[str, ...]]:
    """Build the relaxation asked for and its smaller form, where they fit the size limits.

    Parameters
    ----------
    problem : Problem
        Scaled.
    cliques : Cliques
    objectives : sequence of Polynomial
    options : Options
        With effort ``"plain"`` nothing is changed: the relaxation fits or there is none.
    constrained : bool
        Whether products of constraints and bounds are worth adding: not where the only
        bounds come from a cutoff.

    Returns
    -------
    relaxations : tuple of Relaxation
        To be tried in this order, the cheaper one first; empty if nothing fits.
    notes : tuple of str
    """
    least = least_order(problem, objectives)
    asked, memory = options.order or least, options.memory_limit
    if options.switches is not None:
        order = max(int(options.switches.order or least), least)
        if building_bytes(problem, cliques, order) > min(memory, MOST_BYTES):
            return (), _too_large(order, options, problem, cliques)
        whole = plain_relaxation(problem, cliques, objectives, options.switches)
        fits = solver_bytes(whole) <= memory
        return ((whole,), whole.notes) if fits else ((), _out_of_memory(whole.order, memory))
    notes: tuple[str, ...] = ()
    if asked < least:
        notes = (f"order {asked} raised to {least}, the least for these degrees",)
    plain = options.effort == "plain"
    build = partial(
        relax,
        problem,
        cliques=cliques,
        objectives=objectives,
        products=constrained and not plain,
        terms="none" if constrained or plain else "sign",
    )
    top = max(asked, least)
    if plain:
        if not worth_building(problem, cliques, top, memory):
            return (), _out_of_memory(top, memory)
        full = build(top)
        fits = solver_bytes(full) <= memory
        return ((full,), notes) if fits else ((), _out_of_memory(top, memory))
    fitting_of = partial(_fitting, build, problem, cliques, memory)
    fitting, order = fitting_of(top), top
    lower = options.effort != "auto"  # which has solved lower orders before
    if not fitting[0] and lower and options.solver in _BY_MOMENTS:
        fitting = _for_the_clique_tree(build, problem, cliques, options, top)
    if not fitting[0] and lower:
        fitting, order = _largest_that_fits(fitting_of, least, top)
    if not fitting[0]:
        return (), _too_large(top, options, problem, cliques)
    if order < top:
        notes += (f"order {asked} lowered to {order}: it would be too large",)
    return fitting[0], notes + fitting[1]


def _fitting(
    build: Callable[..., Relaxation], problem: Problem, cliques: Cliques, memory: float, order: int
) -> Fitting:
    """Build the forms of one order that fit the size limits.

    Where the block of the largest clique alone is too large, no form is built.
    """
    if not worth_building(problem, cliques, order, memory):
        return _NOTHING
    # as many blocks as sign symmetry makes of a basis, at most
    blocks = 2 ** max(len(c) for c in cliques.members)
    least = blocks * _entries(largest_basis(cliques, order) // blocks) ** 3 / 3.0
    if least > _OPERATIONS:
        return _NOTHING
    full = build(order)
    bounded = np.isfinite(full.problem.lower) | np.isfinite(full.problem.upper)
    if not full.problem.constraints and not bounded.any():
        return _worthwhile(full, full, memory)  # without multipliers the forms are the same
    return _worthwhile(full, build(order, lean=True), memory)


def _for_the_clique_tree(
    build: Callable[..., Relaxation],
    problem: Problem,
    cliques: Cliques,
    options: Options,
    order: int,
) -> Fitting:
    """Build the form that the clique-tree method alone solves in time: moments are bounded.

    For one clique, that is, where no sparsity offers a smaller one.
    """
    memory = options.memory_limit
    boxed = bool(np.all(np.isfinite(problem.lower) & np.isfinite(problem.upper)))
    if not boxed or len(cliques.members) > 1 or not worth_building(problem, cliques, order, memory):
        return _NOTHING
    for lean in (False, True):
        found = build(order, lean=lean)
        if solver_bytes(found) <= memory and _clique_tree_operations(found) <= _most(options):
            return (found,), ()
    return _NOTHING


def _most(options: Options) -> float:
    """Operations of a step of the clique-tree method that are tried."""
    return _ALONE if options.time_limit is None else min(_ALONE, _A_SECOND * options.time_limit)


def _largest_that_fits(
    fitting_of: Callable[[int], Fitting], least: int, too_large: int
) -> tuple[Fitting, int]:
    """Bisect for the largest order that fits: where one fits, all below do."""
    fitting, low, high = _NOTHING, least - 1, too_large
    while high - low > 1:
        middle = (low + high) // 2
        found = fitting_of(middle)
        if found[0]:
            fitting, low = found, middle
        else:
            high = middle
    return fitting, low


def _worthwhile(full: Relaxation, lean: Relaxation, memory: float) -> Fitting:
    """Choose the lean form where much cheaper, the full one where affordable."""
    if lean is full:
        return ((full,), ()) if affordable(full, memory) else _NOTHING
    cheap, costly = _operations(lean), _operations(full)
    if affordable(full, memory):
        return ((lean, full) if cheap < 0.3 * costly and costly > _TINY else (full,)), ()
    if not affordable(lean, memory):
        return _NOTHING
    return (lean,), (f"{LEAN}: blocks of {max(full.block_sizes)} are too large",)


def _too_large(order: int, options: Options, problem: Problem, cliques: Cliques) -> tuple[str, ...]:
    """Say whether memory or time is missing."""
    memory = options.memory_limit
    block = 12.0 * _entries(largest_basis(cliques, order)) ** 2
    if block > memory or not worth_building(problem, cliques, order, memory):
        return _out_of_memory(order, memory)
    most = _most(options) if options.solver in _BY_MOMENTS else _OPERATIONS
    short = most < _ALONE and options.time_limit is not None
    return (_note(order, "the time left" if short else f"{most:.2g} operations a step"),)


def _out_of_memory(order: int, memory: float) -> tuple[str, ...]:
    return (_note(order, f"{memory / 1e9:.3g} GB"),)


def _note(order: int, limit: str) -> str:
    return (
        f"the relaxation of order {order} {TOO_LARGE} {limit}; "
        "lower the order or exploit more sparsity"
    )
