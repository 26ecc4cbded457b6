"""What all objectives over one feasible set share on their way up the ladder."""

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
    families,
    relaxation_specs,
)
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.tightening.mccormick import coordinate_of

__all__ = ["SharedState", "branching"]

_FEW = 12  # variables whose bounds relaxations tighten: two solves each
_LONG = 300  # constraints beyond which linear programs take longer than relaxations do


def branching(products: Products, options: Options) -> tuple[int, ...]:
    """The variables to cut: those asked for, else those that cover all products."""
    if options.branch_on is not None:
        return tuple(sorted({int(v) for v in options.branch_on}))
    return products.complicating


@dataclass(eq=False)
class SharedState:
    """What all objectives over one feasible set share on their way up.

    Parameters
    ----------
    products : Products
    cliques : dict
        A family of cliques for each way of joining variables.
    variables : tuple of int
        Those that branch and bound may cut.
    recipes : tuple of RelaxationSpec
    experience : Experience
    estimates : dict
        Expected seconds of each recipe.
    active : (m,) bool or None
        The constraints that linear relaxations use; None: all.
    squeeze : RelaxationSpec or None
        The relaxation that tightens bounds in branch and bound, for objectives +-x_v.
    narrow : bool
        Whether linear programs tighten bounds on the whole box.
    """

    products: Products
    cliques: Families
    variables: tuple[int, ...]
    specs: tuple[RelaxationSpec, ...]
    cost_model: CostModel = field(default_factory=CostModel)
    estimates: dict[str, float] = field(default_factory=dict)
    active: NDArray[np.bool_] | None = None
    obbt_sdp: RelaxationSpec | None = None
    narrow: bool = True

    @staticmethod
    def of(problem: Problem, objectives: Sequence[Polynomial], options: Options) -> SharedState:
        """Structure of a problem and its objectives."""
        products = Products.of(problem, objectives)
        cliques = families(problem, objectives, options.sparse, options.chordal)
        specs = relaxation_specs(problem, cliques, tuple(objectives), options.order, options.skip)
        specs = tuple(replace(spec, memory=options.memory_limit) for spec in specs)
        specs = tuple(spec for spec in specs if spec.fits(cliques))
        variables = branching(products, options)
        cuts = "branch" not in options.skip and options.node_limit != 0
        idle = not cuts or "squeeze" in options.skip or len(variables) > _FEW
        inside = all(coordinate_of(p) is not None for p in objectives)  # cut-offs are in the box
        stars = (r for r in specs if r.shape == "star")
        star = next(stars, None) if inside and not idle else None
        short = star is None or len(problem.constraints) <= _LONG
        narrow = "narrow" not in options.skip and short
        return SharedState(products, cliques, variables, specs, obbt_sdp=star, narrow=narrow)

    @property
    def effort(self) -> float:
        """How many relaxations branch and bound is expected to need, up to a factor."""
        count = len(self.variables)
        return count if self.obbt_sdp is not None else 2.0 ** min(count, 8)
