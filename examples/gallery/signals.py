"""Figures 1.3, 1.4, 3.1, 4.2 and 6.4: costs, readings within bounds, held inputs, spectra.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from style import ATTAINED, OTHER, PROVED, save

import setid

generator = np.random.default_rng(3)
u = np.repeat(generator.uniform(-1, 1, 6), 5)
exact = np.zeros(30)
for k in range(1, 30):
    exact[k] = 0.8 * exact[k - 1] + 0.5 * u[k - 1]
read = exact + generator.uniform(-0.15, 0.15, 30)
data = setid.IOData(u, read)
result = setid.identify(data, setid.TransferFunction(na=1, nb=1, nk=1), setid.Noise(output=0.15))
(a_low, a_high), (b_low, b_high) = (result.intervals[n].outer for n in ("a1", "b1"))
print(f"a1 in [{a_low}, {a_high}], b1 in [{b_low}, {b_high}]; the truth is -0.8, 0.5")


def costs():
    figure, axes = plt.subplots(1, 2, figsize=(7.5, 3.4), sharey=True)
    grid = np.meshgrid(np.linspace(-6, 6, 161), np.linspace(-6, 6, 161))
    square = grid[0] ** 2 + grid[1] ** 2
    for ax, value, name in (
        (axes[0], np.sin(grid[0]) * np.cos(grid[1]) + square / 10, "many minima"),
        (axes[1], square, "one minimum"),
    ):
        ax.contour(*grid, value, levels=18, linewidths=0.8, cmap="viridis")
        inner = value[1:-1, 1:-1]
        shifts = [(i, j) for i in (0, 1, 2) for j in (0, 1, 2) if (i, j) != (1, 1)]
        least = np.all([inner <= value[i : i + 159, j : j + 159] for i, j in shifts], axis=0)
        rows, columns = np.nonzero(least)
        at = grid[0][rows + 1, columns + 1], grid[1][rows + 1, columns + 1]
        ax.plot(*at, "o", color=OTHER, markersize=4, label="local minimum")
        best = np.argmin(inner[rows, columns])
        ax.plot(
            at[0][best], at[1][best], "*", color=ATTAINED, markersize=11, label="global minimum"
        )
        ax.set(title=name, xlabel="theta 1")
    axes[0].set_ylabel("theta 2")
    axes[0].legend(loc="lower right", fontsize=8)
    return figure


def readings():
    figure, ax = plt.subplots(figsize=(6.5, 3.2))
    k = np.arange(30)
    ax.fill_between(k, read - 0.15, read + 0.15, color=PROVED, alpha=0.3, label="reading +- bound")
    ax.plot(k, read, ".", color=OTHER, label="reading")
    ax.plot(k, exact, color=ATTAINED, linewidth=1.2, label="true output")
    ax.set(xlabel="sample", ylabel="y", ylim=(-1.7, 1.4))
    ax.legend(fontsize=8, ncols=3)
    return figure


def held():
    figure, axes = plt.subplots(1, 2, figsize=(7.5, 3.0))
    t = np.linspace(0, 10, 400)
    k = np.arange(11)
    axes[0].plot(t, np.sin(0.7 * t), color=OTHER, linewidth=1, label="meant")
    axes[0].step(k, np.sin(0.7 * k), where="post", color=PROVED, label="held")
    axes[0].plot(k, np.sin(0.7 * k), "o", color=ATTAINED, markersize=4, label="sampled")
    axes[0].set(xlabel="time, in samples", ylabel="u")
    axes[0].legend(fontsize=8)
    w = np.linspace(0.02, np.pi, 400)
    noise = np.random.default_rng(1).choice([-1.0, 1.0], 256)
    flat = np.abs(np.exp(-1j * np.outer(w, np.arange(256))) @ noise) / 16
    axes[1].semilogy(w, 1 / (2 * np.sin(w / 2)), color=PROVED, label="step")
    axes[1].semilogy(w, flat, color=OTHER, linewidth=0.8, label="random signs, over 16")
    axes[1].set(xlabel="frequency, rad per sample", ylabel="|U|", ylim=(1e-2, 60))
    axes[1].legend(fontsize=8)
    return figure


save("costs", costs)
save("readings", readings)
save("held_inputs", held)
