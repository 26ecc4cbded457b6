"""A sum of ratios: Shekel's foxholes in the plane, with the proof in a file."""

import sparsepop_py as sp

holes = [(4, 4, 0.1), (1, 1, 0.2), (8, 8, 0.2), (6, 6, 0.4), (3, 7, 0.4)]
x, y = sp.variables(2, ["x", "y"])
depths = [-1 / ((x - a) ** 2 + (y - b) ** 2 + c) for a, b, c in holes]
problem = sp.RationalProblem(sum(depths[1:], depths[0]), lower=0, upper=10)
result = sp.solve(problem, sp.Options(effort="auto", time_limit=60))

print(result.summary())
sp.write_json(result, "ratios.json")
again = sp.read_json("ratios.json")
print(again.certificate, again.certificate.verify(problem).ok)
print("check it without the package: python checker/check.py ratios.json")
