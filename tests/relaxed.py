"""Relaxations, solved."""

from __future__ import annotations

from sparsepop_py import assemble, relax, solve_conic
from sparsepop_py.sparsity import find_cliques

METHODS = ("components", "chordal", "sign")
LOSSLESS = ("components", "sign")


def solved(problem, order, **options):
    relaxation = relax(problem, order, **options)
    solution = solve_conic(assemble(relaxation, problem.objective))
    assert solution.status in ("solved", "almost")  # how near, the values say
    return relaxation, solution


def value(problem, order, **options):
    return solved(problem, order, **options)[1].dual


def dense(problem):
    return find_cliques(problem, sparse=False)
