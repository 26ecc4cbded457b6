"""Figures 3.6, 3.7 and 3.16: sets of parameters and errors, and a set without an end.

Two readings of y_2 = -a y_1 with errors up to 0.3: the pairs of parameter and error that are
possible, and their projection, the interval of a. And two gains in a row: only their product shows.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from style import ATTAINED, OTHER, PROVED, save

import sparsepop_py as sp

Y, BOUND, GAIN = (1.0, -0.8), 0.3, (0.8, 1.2)

a, eta = sp.variables(2)
left = Y[1] + a * (Y[0] - eta)
readings = sp.Problem(a, [left <= BOUND, left >= -BOUND], lower=[-5, -BOUND], upper=[5, BOUND])
low, high = (
    sign * r.lower_bound
    for sign, r in zip((1, -1), sp.solve_each(readings, [a, -a], sp.Options(order=2)), strict=True)
)


def extended():
    figure, ax = plt.subplots(figsize=(5.5, 4.0))
    grid = np.meshgrid(np.linspace(0, 2.2, 221), np.linspace(-0.4, 0.4, 161))
    slack = BOUND - np.abs(Y[1] + grid[0] * (Y[0] - grid[1]))
    inside = np.minimum(slack, BOUND - np.abs(grid[1]))
    ax.contourf(*grid, inside, levels=[0, 9], colors=[ATTAINED], alpha=0.45)
    ax.plot([low, high], [-0.37, -0.37], color=PROVED, linewidth=4, label="proved interval of a")
    for end in (low, high):
        ax.axvline(end, color=PROVED, linestyle=":", linewidth=1)
    ax.fill([], [], color=ATTAINED, alpha=0.45, label="parameters and errors that explain")
    ax.set(xlabel="a", ylabel="error of the first reading", xlim=(0, 2.2), ylim=(-0.4, 0.55))
    ax.legend(loc="upper right", fontsize=8)
    return figure


def unbounded():
    figure, ax = plt.subplots(figsize=(5.5, 4.0))
    c = np.linspace(0.15, 4, 300)
    ax.fill_between(
        c, GAIN[0] / c, GAIN[1] / c, color=PROVED, alpha=0.35, label="c b in the interval"
    )
    ax.plot(c, 1 / c, color=OTHER, linewidth=1, label="c b = 1: one behaviour")
    ax.plot([1, 1], GAIN, color=ATTAINED, linewidth=4, label="after c = 1")
    ax.set(xlabel="gain c of the static block", ylabel="gain b of the linear block", ylim=(0, 4))
    ax.legend(loc="upper right", fontsize=8)
    return figure


print(f"a in [{low:.6f}, {high:.6f}], exactly [{0.5 / 1.3:.6f}, {1.1 / 0.7:.6f}]")
save("extended_set", extended)
save("gains_in_a_row", unbounded)
