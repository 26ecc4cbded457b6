"""Parameter intervals by SparsePOP's own structs: two calls of sparsePOP a parameter.

A second-order system with noise on its output and on its input is the problem of many scripts:

    y_k + a1 y_(k-1) + a2 y_(k-2) - b0 u_k - b1 u_(k-1) - b2 u_(k-2) = 0,
    |y~_k - y_k| <= 0.02,  |u~_k - u_k| <= 0.02.

In the noise samples as unknowns each equation is one row of 12 terms of degree 2 at most.
`setid.to_structs` writes objective, rows and bounds; `sparsePOP` gives a proved bound of each end
and a point that attains a value beyond it. `setid.identify` does all ends at once, closer.
"""

import numpy as np

import setid
import sparsepop_py as sp

THETA = {"a1": -1.0, "a2": 0.4, "b0": 0.5, "b1": 1.0, "b2": -0.3}

model = setid.TransferFunction(na=2, nb=3)
noise = setid.Noise(output=0.02, input=0.02)
u = np.array([1.1, -0.9, 1.0, 0.8, -1.2, 1.0, -1.0, -0.8, 0.9, 1.2, -1.1, 0.9])
data = setid.simulate_record(model, THETA, u, noise, seed=1).data
prior = setid.Box({name: (-3, 3) for name in model.parameters})
param = {"relaxOrder": 1, "printLevel": 0}

objPoly, ineqPolySys, lbd, ubd = setid.to_structs(data, model, noise, prior)
row = ineqPolySys[0]
print(f"{len(ineqPolySys)} rows in {lbd.size} unknowns, {row['noTerms']} terms each; the first:")
names = setid.formulate(data, model, noise, prior).layout.names
for exponents, coefficient in zip(row["supports"], row["coef"].ravel(), strict=True):
    factors = [name for name, power in zip(names, exponents, strict=True) if power]
    print(f"  {coefficient:+.4f}  {'*'.join(factors) or '1'}")

result = setid.identify(data, model, noise, prior)
print("\nparameter   truth  sparsePOP proves     a point attains      setid.identify proves")
for name, truth in THETA.items():
    low = sp.sparsePOP(*setid.to_structs(data, model, noise, prior, name), param)
    high = sp.sparsePOP(*setid.to_structs(data, model, noise, prior, f"-{name}"), param)
    closer = result.intervals[name].outer
    print(
        f"{name:9} {truth:7.2f}  [{low.SDPobjValue:7.4f}, {-high.SDPobjValue:7.4f}]"
        f"   [{low.POP.upperBound:7.4f}, {-high.POP.upperBound:7.4f}]"
        f"   [{closer[0]:7.4f}, {closer[1]:7.4f}]"
    )
