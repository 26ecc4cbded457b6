"""Figure 3.5: the envelope of all transfer functions that a record allows.

theta2 / (s + theta1) from 60 noisy samples of its output, by Tustin's rule. The band is proved:
it contains the response of each consistent pair of parameters.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from style import ATTAINED, PROVED, save

import setid

THETA1, THETA2, TS, BOUND = 1.5, 3.0, 0.1, 0.5

rng = np.random.default_rng(0)
u = rng.uniform(-1, 1, 60)
c, y = 2 / TS, [0.0]
for k in range(1, 60):  # (c (1 - q) + theta1 (1 + q)) y = theta2 (1 + q) u, with errors
    right = THETA2 * (u[k] + u[k - 1]) + (c - THETA1) * y[-1] + rng.uniform(-BOUND, BOUND)
    y.append(right / (c + THETA1))
data = setid.IOData(u, y, Ts=TS)
model = setid.ContinuousTransferFunction(1, 0)
scale = setid.consistency(data, model, setid.Noise(equation=1.0)).scale[1]
result = setid.identify(data, model, setid.Noise(equation=1.2 * scale))
omega = np.geomspace(0.1, 20, 60)
band = setid.frequency_band(result, omega)


def draw():
    figure, (gain, phase) = plt.subplots(2, 1, sharex=True, figsize=(5.5, 4.5))
    true = THETA2 / (1j * omega + THETA1)
    for ax, ends, curve, name in (
        (gain, band.decibel, 20 * np.log10(np.abs(true)), "gain, dB"),
        (phase, np.degrees(band.phase), np.degrees(np.angle(true)), "phase, degrees"),
    ):
        ax.fill_between(omega, *ends.T, color=PROVED, alpha=0.35, label="all consistent, proved")
        ax.plot(omega, curve, color=ATTAINED, label="true system")
        ax.set_xscale("log")
        ax.set_ylabel(name)
        ax.grid(alpha=0.3)
    gain.legend(fontsize=8)
    phase.set_xlabel("frequency, rad/s")
    return figure


save("bode_envelope", draw)
