"""Small problems for searches with known minima, and searches on them."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np

import sparsepop_py as sp
from sparsepop_py import Options, Problem
from sparsepop_py.branch_and_bound.node import NodeSettings
from sparsepop_py.branch_and_bound.tree import SearchTree
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.progress import Stages
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import BoxProof


def bilinear():
    """min x y + z w - x w with x + y + z + w <= 2, a square of four corners and more."""
    x, y, z, w = sp.variables(4)
    rows = [x + y + z + w <= 2, x * y + z * w >= -1]
    return Problem(x * y + z * w - x * w, rows, -1.0, 2.0)


def heat_exchangers():
    """Hock and Schittkowski 1981, problem 106: the minimum 7049.248 is no vertex."""
    x1, x2, x3, x4, x5, x6, x7, x8 = sp.variables(8)
    rows = [
        0.0025 * (x4 + x6) <= 1,
        0.0025 * (x5 + x7 - x4) <= 1,
        0.01 * (x8 - x5) <= 1,
        100 * x1 - x1 * x6 + 833.33252 * x4 <= 83333.333,
        x2 * x4 - x2 * x7 - 1250 * x4 + 1250 * x5 <= 0,
        x3 * x5 - x3 * x8 - 2500 * x5 <= -1250000,
    ]
    lower = [100, 1000, 1000, 10, 10, 10, 10, 10]
    return Problem(x1 + x2 + x3, rows, lower, [700, 2000, 6000, 300, 400, 400, 400, 500])


def least_on_a_grid(problem, steps):
    axes = [np.linspace(a, b, steps) for a, b in zip(problem.lower, problem.upper, strict=True)]
    x, y, z, w = np.meshgrid(*axes, indexing="ij")
    inside = (x + y + z + w <= 2) & (x * y + z * w >= -1)
    return float((x * y + z * w - x * w)[inside].min())


def search_of(problem, variables, start=None, options=None, local=False, **settings):
    context = SolveContext(problem, options or Options(), Stages(), Deadline(None))
    if start is not None:
        context = replace(context, best=prove_feasible(problem, np.array(start, float)))
        assert context.best is not None
    box = Interval(problem.lower, problem.upper)
    cliques = {"constraints": find_cliques(problem)}
    search_incumbent = (lambda t, x: update_incumbent(t, x)[0]) if local else lambda t, x: t
    return SearchTree(
        context, NodeSettings(cliques, variables, **settings), BoxProof(), box, search_incumbent
    )


def branched_on(certificate):
    return {node.branch[0] for node in certificate.root if node.branch is not None}


def threads():
    return ThreadPoolExecutor(2)


def processes():
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))
