"""A problem from Python expressions: the two largest equal discs in a square."""

import sparsepop_py as sp

x1, y1, x2, y2, r = sp.variables(5, ["x1", "y1", "x2", "y2", "r"])
inside = [c >= r for c in (x1, y1, x2, y2)] + [c + r <= 1 for c in (x1, y1, x2, y2)]
apart = (x1 - x2) ** 2 + (y1 - y2) ** 2 >= 4 * r**2
problem = sp.Problem(-r, [*inside, apart], lower=0, upper=1)
result = sp.solve(problem, sp.Options(order=2))

print(problem)
print(result.summary())
