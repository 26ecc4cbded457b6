"""Figures 3.8 to 3.11, 5.2 and 5.3: a set that is not convex, its relaxations, its centre.

Two pieces of a square. Relaxations of order 1 and 2 bound each linear objective over them. The
half-planes that they prove meet in a convex set.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Rectangle
from style import ATTAINED, OTHER, PROVED, save

import sparsepop_py as sp

ORDERS, ANGLES = (1, 2), np.linspace(0, 2 * np.pi, 49)[:-1]

x1, x2 = sp.variables(2)
first, second = x1 * x2 - 0.1, x1**2 + 0.5 * x2 - x2**2 - 0.1
rows = [x1**2 <= 1, x2**2 <= 1, first >= 0, second >= 0]
pieces = sp.Problem(x1, rows)
directions = np.column_stack((np.cos(ANGLES), np.sin(ANGLES)))
objectives = [float(c) * x1 + float(s) * x2 for c, s in directions]
support = {
    order: np.array(
        [
            r.lower_bound
            for r in sp.solve_each(pieces, objectives, sp.Options(order=order, effort="plain"))
        ]
    )
    for order in ORDERS
}
steep = int(np.argmax(support[2] - support[1]))  # where order 2 proves most more
relaxed = sp.sparsePOP(
    *sp.to_structs(sp.Problem(objectives[steep], rows)),
    {"relaxOrder": 1, "tighten": 0, "printLevel": 0},
).POP.xVect
box = [
    (low.lower_bound, -high.lower_bound)
    for low, high in (
        sp.solve_each(pieces, [x, -x], sp.Options(order=2, effort="plain")) for x in (x1, x2)
    )
]


def corners(order):
    """Where the half-planes of neighbouring directions meet."""
    found = []
    for k in range(len(ANGLES)):
        pair = [k - 1, k]
        found.append(np.linalg.solve(directions[pair], support[order][pair]))
    return np.array([*found, found[0]])


def background(ax):
    grid = np.array(np.meshgrid(np.linspace(-1.2, 1.2, 481), np.linspace(-1.2, 1.2, 481)))
    points = grid.reshape(2, -1).T
    inside = np.minimum(first(points), second(points)).reshape(grid.shape[1:])
    inside[np.abs(grid).max(axis=0) > 1] = -1
    ax.contourf(*grid, inside, levels=[0, 9], colors=[ATTAINED], alpha=0.45)
    ax.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.9), xlabel="x1", ylabel="x2", aspect="equal")


def hulls():
    figure, ax = plt.subplots(figsize=(5.0, 5.6))
    background(ax)
    for order, style in zip(ORDERS, ("--", "-"), strict=True):
        ax.plot(*corners(order).T, style, color=PROVED, label=f"proved by order {order}")
    normal, along = directions[steep], np.array([-directions[steep][1], directions[steep][0]])
    for level in support[1][steep] + np.array([0, 0.4, 0.8, 1.2]):
        ends = np.array([level * normal - 3 * along, level * normal + 3 * along])
        ax.plot(*ends.T, ":", color=OTHER, linewidth=0.8)
    ax.plot([], [], ":", color=OTHER, label="one value of an objective")
    ax.plot(*np.ravel(relaxed), "*", color="red", markersize=11, label="relaxed point")
    ax.fill([], [], color=ATTAINED, alpha=0.45, label="the set")
    ax.legend(loc="upper right", fontsize=8)
    return figure


def centre():
    figure, ax = plt.subplots(figsize=(5.0, 5.6))
    background(ax)
    (a, b), (c, d) = box
    ax.add_patch(Rectangle((a, c), b - a, d - c, fill=False, color=PROVED, label="proved box"))
    middle = (a + b) / 2, (c + d) / 2
    ax.plot(*middle, "*", color="red", markersize=11, label="its centre, outside of the set")
    ax.fill([], [], color=ATTAINED, alpha=0.45, label="the set")
    ax.legend(loc="upper right", fontsize=8)
    return figure


save("relaxed_sets", hulls)
save("central_estimate", centre)
