"""State shared by all objectives over one feasible set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.hierarchy import (
    CostModel,
    Families,
    RelaxationSpec,
    relaxation_specs,
)
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.tightening.mccormick import coordinate_of

__all__ = ["SharedState", "branching_variables"]


def branching_variables(products: Products, options: Options) -> tuple[int, ...]:
    """Choose the branching variables: those asked for, else those that cover all products.

    Parameters
    ----------
    products : Products
    options : Options

    Returns
    -------
    tuple of int
        From 0, in ascending order where they were asked for.
    """
    if options.branch_on is not None:
        return tuple(sorted({int(v) for v in options.branch_on}))
    return products.complicating


@dataclass(eq=False)
class SharedState:
    """State shared by all objectives over one feasible set.

    Parameters
    ----------
    products : Products
        Products of variables in the problem and its objectives.
    cliques : dict
        Cliques for each way of joining variables.
    variables : tuple of int
        Branching variables.
    specs : tuple of RelaxationSpec
        The relaxations that the problem admits.
    cost_model : CostModel
        Seconds and progress of relaxations solved so far.
    estimates : dict
        Expected seconds of relaxations not solved yet, by name.
    active : (m,) bool or None
        The constraints that linear relaxations use; None: all.
    obbt_sdp : RelaxationSpec or None
        The relaxation that tightens bounds in branch and bound, for objectives +-x_v.
    obbt_lp : bool
        Whether linear programs tighten bounds on the root box.
    """

    products: Products
    cliques: Families
    variables: tuple[int, ...]
    specs: tuple[RelaxationSpec, ...]
    cost_model: CostModel = field(default_factory=CostModel)
    estimates: dict[str, float] = field(default_factory=dict)
    active: NDArray[np.bool_] | None = None
    obbt_sdp: RelaxationSpec | None = None
    obbt_lp: bool = True

    @staticmethod
    def of(problem: Problem, objectives: Sequence[Polynomial], options: Options) -> SharedState:
        """Analyse the structure of a problem and its objectives."""
        products = Products.of(problem, objectives)
        cliques = Families(problem, objectives, options.sparse, options.chordal)
        specs = relaxation_specs(problem, cliques, tuple(objectives), options.order, options.skip)
        specs = tuple(replace(spec, memory=options.memory_limit) for spec in specs)
        specs = tuple(spec for spec in specs if spec.fits(cliques))
        variables = branching_variables(products, options)
        branches = "branch" not in options.skip and options.node_limit != 0
        may = (
            branches and "obbt_sdp" not in options.skip and len(variables) <= STRATEGY.few_variables
        )
        inside = all(coordinate_of(p) is not None for p in objectives)  # the box holds the cutoffs
        stars = (r for r in specs if r.shape == "star")
        star = next(stars, None) if inside and may else None
        short = star is None or len(problem.constraints) <= STRATEGY.long_problem_constraints
        obbt_lp = "obbt_lp" not in options.skip and short
        return SharedState(products, cliques, variables, specs, obbt_sdp=star, obbt_lp=obbt_lp)

    @property
    def effort(self) -> float:
        """Number of relaxations that branch and bound is expected to need, up to a factor."""
        count = len(self.variables)
        return count if self.obbt_sdp is not None else 2.0 ** min(count, 8)
