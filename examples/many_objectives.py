"""Guaranteed parameter intervals of a tiny system: many objectives, one relaxation.

A first-order system z[k] = a z[k-1] + b u[k-1] is observed as y[k] = z[k] + noise, with
|noise| <= 0.05. Which a and b are compatible with the record? Each interval end is a
polynomial problem; the feasible set, and so the relaxation, is the same for all four.
"""

import numpy as np

import sparsepop_py as sp

A, B, NOISE = 0.6, 1.5, 0.05
u = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
z = [0.0]
for k in range(u.size):
    z.append(A * z[-1] + B * u[k])
y = np.round(z + NOISE * np.array([0.5, -0.8, 0.3, 0.9, -0.4, -0.7, 0.6]), 3)

a, b, *state = sp.variables(2 + y.size, ["a", "b", *(f"z{k}" for k in range(y.size))])
rows = [state[k + 1] == a * state[k] + b * u[k] for k in range(u.size)]
lower = np.concatenate([[-0.95, 0.0], y - NOISE])
upper = np.concatenate([[0.95, 5.0], y + NOISE])
record = sp.Problem(a, rows, lower, upper)

results = sp.solve_each(record, [a, -a, b, -b], sp.Options(order=2))
for name, true, low, high in (("a", A, *results[:2]), ("b", B, *results[2:])):
    outer = low.lower_bound, -high.lower_bound  # rounded outwards to be shown
    inner = low.upper_bound, -high.upper_bound  # rounded inwards
    print(f"{name}  true value {true}")
    print(f"   outer (proved)    [{sp.rounded(outer[0], False)}, {sp.rounded(outer[1], True)}]")
    print(f"   inner (attained)  [{sp.rounded(inner[0], True)}, {sp.rounded(inner[1], False)}]")
print("one relaxation for all:", all(r.relaxation is results[0].relaxation for r in results))
