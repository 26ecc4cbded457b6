"""Figures 3.2, 3.3 and 9.1: a feasible set of two parameters and its intervals.

y_k + a1 y_(k-1) = b0 u_k + e_k with |e_k| <= 0.5. Each sample is a strip; the set is where all
strips meet, and the intervals are the sides of the smallest box around it.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Rectangle
from style import ATTAINED, OTHER, PROVED, save

import setid

U, Y, BOUND, TRUTH = [4.0, -3.0, 2.0, 1.0], [0.0, -6.25, 1.175, 2.0875], 0.5, (-0.5, 2.0)

data = setid.IOData(U, Y)
result = setid.identify(data, setid.TransferFunction(na=1, nb=1), setid.Noise(equation=BOUND))
corners = result.fps("a1", "b0").outline


def draw():
    figure, ax = plt.subplots(figsize=(5.5, 4.2))
    a = np.linspace(-0.75, -0.1, 2)
    for k, style in zip(range(1, 4), ("-", "--", ":"), strict=True):
        for side in (BOUND, -BOUND):
            b = (Y[k] + a * Y[k - 1] + side) / U[k]
            label = f"sample {k + 1}" if side > 0 else None
            ax.plot(a, b, style, color=OTHER, linewidth=1, label=label)
    ax.fill(*corners.T, color=PROVED, alpha=0.35, label="feasible set, exact")
    (a_low, a_high), (b_low, b_high) = (result.intervals[name].outer for name in ("a1", "b0"))
    box = Rectangle((a_low, b_low), a_high - a_low, b_high - b_low, fill=False, color=PROVED)
    ax.add_patch(box)
    ax.plot(*TRUTH, "*", color=ATTAINED, markersize=11, label="true parameters")
    ax.set(xlabel="a1", ylabel="b0", xlim=(-0.65, -0.2), ylim=(1.8, 2.2))
    ax.legend(loc="lower right", fontsize=8)
    return figure


save("feasible_set", draw)
