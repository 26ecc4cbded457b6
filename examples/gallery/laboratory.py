"""Figures 10.1 to 10.4 and the table of orders: the laboratory problem.

min x1^2 + x2^2 - 4 x1 - 6 x2 + 13  s.t.  x1 x2 - 7 x2 = 10,  x2 >= 1 - x1 / 2.
The relaxed point of an order comes from the moments, the refined one is attained.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from style import ATTAINED, OTHER, PROVED, save

import sparsepop_py as sp

ORDERS = (1, 2, 3, 4)

problem = sp.read_gms(Path(__file__).resolve().parents[1] / "problems" / "laboratory.gms")
boxed = sp.Problem(problem.objective, problem.constraints, lower=-1e3, upper=1e3)
found = {
    d: sp.sparsePOP(
        *sp.to_structs(boxed),
        {"relaxOrder": d, "tighten": 0, "printLevel": 0, "POPsolver": "active-set"},
    )
    for d in ORDERS
}
proved = {d: sp.solve(problem, sp.Options(order=d)) for d in ORDERS}
best = sp.solve(problem, sp.Options(effort="auto", work_limit=30))


def background(ax):
    """Contours of the objective, the hyperbola and the half-plane."""
    x1, x2 = np.linspace(-15, 15, 61), np.linspace(-12, 12, 61)
    grid = np.meshgrid(x1, x2)
    value = grid[0] ** 2 + grid[1] ** 2 - 4 * grid[0] - 6 * grid[1] + 13
    ax.contour(*grid, value, levels=np.arange(5, 255, 25), linewidths=0.6, cmap="viridis")
    for part in (np.linspace(0.05, 12, 200), np.linspace(-12, -0.05, 200)):
        ax.plot(7 + 10 / part, part, color=OTHER, linewidth=1.5)
    ax.fill_between(x1, 1 - x1 / 2, 12, color=PROVED, alpha=0.12)
    ax.plot(x1, 1 - x1 / 2, color=PROVED, linewidth=1)
    ax.set(xlim=(-15, 15), ylim=(-12, 12), xlabel="x1", ylabel="x2")


def contours():
    figure, ax = plt.subplots(figsize=(5.5, 4.5))
    background(ax)
    ax.plot(*best.x, "*", color=ATTAINED, markersize=12, label=f"minimum {best.upper_bound:.4f}")
    ax.plot([], [], color=OTHER, label="x1 x2 - 7 x2 = 10")
    ax.fill([], [], color=PROVED, alpha=0.12, label="x2 >= 1 - x1 / 2")
    ax.legend(loc="lower left", fontsize=8)
    return figure


def points():
    figure, axes = plt.subplots(2, 2, figsize=(7.5, 6.0), sharex=True, sharey=True)
    for ax, order in zip(axes.flat, ORDERS, strict=True):
        background(ax)
        pop = found[order].POP
        for vector, colour, name in (
            (pop.xVect, "red", "relaxed"),
            (pop.xVectL, ATTAINED, "refined"),
        ):
            vector = np.ravel(vector)
            if vector.size == 2:
                ax.plot(*vector, "*", color=colour, markersize=10, label=name)
        ax.set_title(f"order {order}", fontsize=9)
        ax.label_outer()
    axes[0, 0].legend(loc="lower left", fontsize=8)
    return figure


def orders():
    figure, ax = plt.subplots(figsize=(5.5, 3.6))
    plain = [found[d].POP.solverValue for d in ORDERS]
    presolved = [proved[d].lower_bound for d in ORDERS]
    ax.plot(ORDERS, plain, "o--", color=OTHER, label="value of the relaxation on [-1000, 1000]^2")
    ax.plot(ORDERS, presolved, "s-", color=PROVED, label="lower bound with presolve, proved")
    ax.axhline(best.upper_bound, color=ATTAINED, label="attained")
    ax.set(xlabel="relaxation order", xticks=ORDERS, ylabel="objective")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure


print("order  relaxation on [-1000, 1000]^2  proved with presolve")
for d in ORDERS:
    print(f"{d:5d}  {found[d].POP.solverValue:28.4f}  {proved[d].lower_bound:20.6f}")
save("laboratory_problem", contours)
save("laboratory_points", points)
save("laboratory_orders", orders)
