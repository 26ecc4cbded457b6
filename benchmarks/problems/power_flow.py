"""Optimal power flow of a grid with 14 buses.

Bus i has the complex voltage V_i = e_i + i f_i, and line (i, j) takes in S_ij = V_i (Y V)_ij*
at its end i. Generators feed P_i + i Q_i. All powers are in units of 100 MVA.

    min sum over generators of c_i P_i,
    P_i - demand = real part of all S_ij and of the shunt at i,  Q_i likewise,
    lower <= P_i, Q_i, |V_i| <= upper,  |S_ij| <= rating,  |angle(V_i / V_j)| <= 30 degrees.

P_i and Q_i are no variables: the balance at their bus says what they are. The phase of the first
bus is 0. That leaves 27 variables, and rows of degree 2, those of ratings of degree 4.

References
----------
R. D. Christie, Power Systems Test Case Archive, University of Washington, 1993: the IEEE 14-bus
case. S. Babaeinejadsarookolaee et al., The Power Grid Library for benchmarking AC optimal power
flow algorithms, arXiv:1908.02788: case14_ieee, release 17.08, ratings and costs (CC BY 4.0).
"""

from __future__ import annotations

import math

import sparsepop_py as sp

from ..measuring.registry import Task

__all__ = ["OPTIMUM", "power_flow"]

OPTIMUM = 6291.28  # release 17.08: 6.2913e+03
_BASE = 100.0
_DEMAND = {  # bus: MW, MVAr
    2: (21.7, 12.7),
    3: (94.2, 19.0),
    4: (47.8, -3.9),
    5: (7.6, 1.6),
    6: (11.2, 7.5),
    9: (29.5, 16.6),
    10: (9.0, 5.8),
    11: (3.5, 1.8),
    12: (6.1, 1.6),
    13: (13.5, 5.8),
    14: (14.9, 5.0),
}
_SHUNT = {9: 19.0}  # bus: MVAr at voltage 1
_GENERATORS = {  # bus: dollars a MWh, most MW, least and most MVAr; the least MW are 0
    1: (22.879299, 340.0, 0.0, 10.0),
    2: (36.375423, 59.0, -30.0, 30.0),
    3: (0.0, 0.0, 0.0, 40.0),
    6: (0.0, 0.0, -6.0, 24.0),
    8: (0.0, 0.0, -6.0, 24.0),
}
_LINES = (  # buses, resistance, reactance, charging, MVA, turns ratio
    (1, 2, 0.01938, 0.05917, 0.0528, 472.0, 1.0),
    (1, 5, 0.05403, 0.22304, 0.0492, 128.0, 1.0),
    (2, 3, 0.04699, 0.19797, 0.0438, 145.0, 1.0),
    (2, 4, 0.05811, 0.17632, 0.034, 158.0, 1.0),
    (2, 5, 0.05695, 0.17388, 0.0346, 161.0, 1.0),
    (3, 4, 0.06701, 0.17103, 0.0128, 160.0, 1.0),
    (4, 5, 0.01335, 0.04211, 0.0, 664.0, 1.0),
    (4, 7, 0.0, 0.20912, 0.0, 141.0, 0.978),
    (4, 9, 0.0, 0.55618, 0.0, 53.0, 0.969),
    (5, 6, 0.0, 0.25202, 0.0, 117.0, 0.932),
    (6, 11, 0.09498, 0.1989, 0.0, 134.0, 1.0),
    (6, 12, 0.12291, 0.25581, 0.0, 104.0, 1.0),
    (6, 13, 0.06615, 0.13027, 0.0, 201.0, 1.0),
    (7, 8, 0.0, 0.17615, 0.0, 167.0, 1.0),
    (7, 9, 0.0, 0.11001, 0.0, 267.0, 1.0),
    (9, 10, 0.03181, 0.0845, 0.0, 325.0, 1.0),
    (9, 14, 0.12711, 0.27038, 0.0, 99.0, 1.0),
    (10, 11, 0.08205, 0.19207, 0.0, 141.0, 1.0),
    (12, 13, 0.22092, 0.19988, 0.0, 99.0, 1.0),
    (13, 14, 0.17093, 0.34802, 0.0, 76.0, 1.0),
)
_BUSES = 14
_LOW, _HIGH = 0.94, 1.06  # voltages
_TANGENT = math.tan(math.radians(30.0))


def power_flow(ratings: bool) -> Task:
    """Write the problem.

    Parameters
    ----------
    ratings : bool
        Whether lines have ratings. None of them binds at the optimum, so the optimum is the same.
    """
    bus = range(1, _BUSES + 1)
    x = sp.variables(2 * _BUSES - 1, [f"e{i}" for i in bus] + [f"f{i}" for i in bus[1:]])
    e = dict(zip(bus, x, strict=False))
    f = {1: 0.0 * x[0], **dict(zip(bus[1:], x[_BUSES:], strict=True))}
    square = {i: e[i] ** 2 + f[i] ** 2 for i in bus}
    real = {i: [0.0 * x[0]] for i in bus}
    reactive = {i: [-_SHUNT.get(i, 0.0) / _BASE * square[i]] for i in bus}
    rows = [square[i] >= _LOW**2 for i in bus] + [square[i] <= _HIGH**2 for i in bus]
    for i, j, resistance, reactance, charging, rating, turns in _LINES:
        series = 1.0 / complex(resistance, reactance)
        own = series + 0.5j * charging
        inner, outer = e[i] * e[j] + f[i] * f[j], f[i] * e[j] - e[i] * f[j]
        for k, sign, scale in ((i, 1.0, turns**2), (j, -1.0, 1.0)):
            # V_k (own V_k / scale - series V_l / turns)*
            p = own.real / scale * square[k]
            p = p - series.real / turns * inner - sign * series.imag / turns * outer
            q = -own.imag / scale * square[k]
            q = q + series.imag / turns * inner - sign * series.real / turns * outer
            real[k].append(p)
            reactive[k].append(q)
            if ratings:
                rows.append(p**2 + q**2 <= (rating / _BASE) ** 2)
        rows += [outer <= _TANGENT * inner, outer >= -_TANGENT * inner]
    cost = []
    for i in bus:
        demand = _DEMAND.get(i, (0.0, 0.0))
        p = sp.total(real[i]) + demand[0] / _BASE
        q = sp.total(reactive[i]) + demand[1] / _BASE
        price, most, *limits = _GENERATORS.get(i, (0.0, 0.0, 0.0, 0.0))
        if price:
            cost.append(price * _BASE * p)
        rows += [p == 0.0] if most == 0.0 else [p >= 0.0, p <= most / _BASE]
        if i in _GENERATORS:
            rows += [q >= limits[0] / _BASE, q <= limits[1] / _BASE]
        else:
            rows.append(q == 0.0)
    lower = [_LOW] + [-_HIGH] * (2 * _BUSES - 2)
    return Task.of(sp.Problem(sp.total(cost), rows, lower, _HIGH), OPTIMUM)
