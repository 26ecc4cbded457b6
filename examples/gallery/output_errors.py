"""Feasible sets under output errors are not convex; the proved box contains them.

The same record with |eta_k| <= 0.6 on the outputs. For given a1 and b0 the noise-free outputs are
w_k = (-a1)^(k-1) w_1 + b0 s_k, so that an interval of w_1 decides, in closed form, whether they
are consistent: the picture of the set does not come from what it is compared with.
"""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Rectangle
from style import ATTAINED, PROVED, save

import setid

U, Y, BOUND = [4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875], 0.6

data = setid.IOData(U, Y)
model, noise = setid.TransferFunction(na=1, nb=1), setid.Noise(output=BOUND)
result = setid.identify(data, model, noise, [setid.Box({"a1": (-0.9, 0.9)})])


def consistent(a, b):
    """Whether some w_1 keeps all |y_k - w_k| within the bound, for arrays of parameters."""
    low, high = np.full(a.shape, Y[0] - BOUND), np.full(a.shape, Y[0] + BOUND)
    power, driven = np.ones(a.shape), np.zeros(a.shape)
    for k in range(1, 4):
        power, driven = -a * power, -a * driven + b * U[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(
                [(Y[k] - BOUND - driven) / power, (Y[k] + BOUND - driven) / power], axis=0
            )
        low, high = np.fmax(low, ends[0]), np.fmin(high, ends[1])
    return low <= high


def draw():
    figure, ax = plt.subplots(figsize=(5.5, 4.2))
    (a_low, a_high), (b_low, b_high) = (result.intervals[name].outer for name in ("a1", "b0"))
    wide = 0.1 * (a_high - a_low), 0.1 * (b_high - b_low)
    a, b = np.meshgrid(
        np.linspace(a_low - wide[0], a_high + wide[0], 601),
        np.linspace(b_low - wide[1], b_high + wide[1], 601),
    )
    inside = consistent(a, b).astype(float)
    ax.contourf(a, b, inside, levels=[0.5, 1.5], colors=[ATTAINED], alpha=0.6)
    box = Rectangle((a_low, b_low), a_high - a_low, b_high - b_low, fill=False, color=PROVED, lw=2)
    ax.add_patch(box)
    ax.plot([], [], color=PROVED, lw=2, label="intervals, proved")
    ax.fill([], [], color=ATTAINED, alpha=0.6, label="feasible set, by enumeration")
    ax.set(xlabel="a1", ylabel="b0")
    ax.legend(fontsize=8)
    return figure


save("output_errors", draw)
