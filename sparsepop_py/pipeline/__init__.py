"""Pipeline from a problem to proved bound, attained point, gap and status.

    search -> box -> scale -> cliques -> relax -> assemble -> solve -> certify -> extract

One pass is :mod:`sparsepop_py.bounding.order_bound`, the loop over passes
:mod:`sparsepop_py.strategy.order_loop`. ``one_objective`` runs both. ``many_objectives`` shares
them between objectives, or hands each to a worker (``separate_tasks``). ``final_result`` makes
results of what a search proved and attained.
"""

from sparsepop_py.pipeline.many_objectives import solve_each
from sparsepop_py.pipeline.one_objective import solve

__all__ = ["solve", "solve_each"]
