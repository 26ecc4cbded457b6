"""How the proved bound grows with the relaxation order, with and without presolve."""

from pathlib import Path

import sparsepop_py as sp

PROBLEMS = Path(__file__).resolve().parent / "problems"

print("problem     order  effort     status     proved lower bound  largest block")
for name in ("laboratory", "chain"):
    problem = sp.read_gms(PROBLEMS / f"{name}.gms")
    for order in (1, 2, 3):
        for effort in ("plain", "presolve"):
            result = sp.solve(problem, sp.Options(order=order, effort=effort))
            bound = sp.rounded(result.lower_bound, upwards=False)
            largest = max(result.relaxation.block_sizes) if result.relaxation else 0
            print(f"{name:<12}{order:>5}  {effort:<9}  {result.status:<9}{bound:>20}{largest:>15}")
