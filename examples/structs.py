"""SparsePOP's own structs through the call of the original.

minimise    x1^2 - 3 x2 x3 + 4 x3
subject to  12 - x1^2 - x2^2 - x3^2 >= 0,  x1 x2 + x3 - 2 >= 0,  x1 + x2 - x3 - 0.5 == 0,
            0 <= x1 <= 5,  0 <= x2 <= 3
"""

import numpy as np

import sparsepop_py as sp


def polynomial(terms: dict[tuple[int, ...], float], cone: int = 1) -> dict[str, object]:
    """Struct with a coefficient for each row of exponents; cone -1 makes an equation."""
    supports = np.array(list(terms))
    return {
        "typeCone": cone,
        "sizeCone": 1,
        "dimVar": supports.shape[1],
        "degree": int(supports.sum(axis=1).max()),
        "noTerms": supports.shape[0],
        "supports": supports,
        "coef": np.array(list(terms.values())),
    }


objPoly = polynomial({(2, 0, 0): 1.0, (0, 1, 1): -3.0, (0, 0, 1): 4.0})
ineqPolySys = [
    polynomial({(0, 0, 0): 12.0, (2, 0, 0): -1.0, (0, 2, 0): -1.0, (0, 0, 2): -1.0}),
    polynomial({(1, 1, 0): 1.0, (0, 0, 1): 1.0, (0, 0, 0): -2.0}),
    polynomial({(1, 0, 0): 1.0, (0, 1, 0): 1.0, (0, 0, 1): -1.0, (0, 0, 0): -0.5}, cone=-1),
]
lbd, ubd = [0.0, 0.0, -1e10], [5.0, 3.0, 1e10]  # 1e10 stands for no bound

param, value, POP, *_ = sp.sparsePOP(objPoly, ineqPolySys, lbd, ubd, {"relaxOrder": 2})

print()
print(f"status            {POP.status}")
print(f"SDPobjValue       {value!r}  proved: no feasible point has a smaller objective")
print(f"POP.upperBound    {POP.upperBound!r}  attained by a point that provably exists")
print(f"POP.solverValue   {POP.solverValue!r}  what the solver said: no bound")
print(f"POP.xVect         {POP.xVect}")

plain = {"relaxOrder": 2, "tighten": 0, "printLevel": 0}
print(f"param.tighten = 0 {sp.sparsePOP(objPoly, ineqPolySys, lbd, ubd, plain).SDPobjValue!r}")
