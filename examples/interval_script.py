"""Parameter intervals by the loop that scripts for SparsePOP have, 2 p calls of sparsePOP.

y_k = -a y_{k-1} + b u_{k-1}, outputs measured with errors |eta_k| <= 0.5. Unknown are a, b
and all errors; row k says (y~_k - eta_k) + a (y~_{k-1} - eta_{k-1}) - b u_{k-1} == 0. As
usual the parameters have no bounds but +-1e10. In the original POP.xVectL(i), a local
point, becomes the interval; here SDPobjValue is proved, and the two can be compared.
"""

import numpy as np

import sparsepop_py as sp

N, NOISE, TRUTH = 20, 0.5, np.array([-0.8, 2.0])
rng = np.random.default_rng(1)
u = rng.uniform(-5, 5, N)
clean = np.zeros(N)
for k in range(1, N):
    clean[k] = -TRUTH[0] * clean[k - 1] + TRUTH[1] * u[k - 1]
y = clean + NOISE * rng.uniform(-1, 1, N)

n = 2 + N  # a, b, eta_1 ... eta_N
ineqPolySys = []
for k in range(1, N):
    supports = np.zeros((6, n), int)  # 1, eta_k, a, a eta_{k-1}, b
    supports[1, 2 + k] = supports[2, 0] = supports[4, 1] = 1
    supports[3, 0] = supports[3, 2 + k - 1] = 1
    row = {"typeCone": -1, "sizeCone": 1, "dimVar": n, "degree": 2, "noTerms": 5}
    coef = np.array([y[k], -1.0, y[k - 1], -1.0, -u[k - 1]])
    ineqPolySys.append({**row, "supports": supports[:5], "coef": coef})
lbd = np.concatenate([[-1e10, -1e10], np.full(N, -NOISE)])
param = {"relaxOrder": 2, "POPsolver": "active-set", "printLevel": 0}

ends = np.zeros((2, 2, 2))  # parameter, proved or attained, end
for i in range(2):
    for side, sign in enumerate((1.0, -1.0)):
        unit = np.zeros((1, n), int)
        unit[0, i] = 1
        one = {"typeCone": 1, "sizeCone": 1, "dimVar": n, "degree": 1, "noTerms": 1}
        objPoly = {**one, "supports": unit, "coef": np.array([sign])}
        _, SDPobjValue, POP, *_ = sp.sparsePOP(objPoly, ineqPolySys, lbd, -lbd, param)
        ends[i, :, side] = sign * SDPobjValue, POP.xVectL[i]

print("parameter    true   proved interval                      attained interval")
for name, true, (proved, attained) in zip("ab", TRUTH, ends, strict=True):
    low = sp.rounded(proved[0], upwards=False, scientific=True)
    high = sp.rounded(proved[1], upwards=True, scientific=True)
    print(f"{name}          {true:6.2f}   [{low}, {high}]", end="   ")
    print(f"[{attained[0]:+.9e}, {attained[1]:+.9e}]")
