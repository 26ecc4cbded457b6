"""Figure 6.10: a controller from data and the proved bound of abs(Delta).

The plant and the reference model of Cerone's course notes, with a record of 400 samples.
Delta = M - K P (1 - M) below 1 for each consistent plant proves that the loop is stable. Between
grid points nothing is assumed: the bound holds on whole arcs.

Numbers of figures: V. Cerone, course notes, Laboratory of Robust Identification and Control,
Politecnico di Torino (2024/25).
"""

import numpy as np
from matplotlib import pyplot as plt
from style import save

import setid
from setid import control

BOUND = 0.002

plant = control.Transfer(
    [0, 0.09516, 0.02, 0.05, -0.04], [1, -0.9048, 0.2, -0.5, 0.4]
)  # unknown in practice
M = control.Transfer([0, 0.4], [1, -0.6])
r = np.random.default_rng(0).uniform(-1, 1, 400)
y = plant.simulate(r) + np.random.default_rng(1).uniform(-BOUND, BOUND, 400)
data = setid.IOData(r, y)
options = setid.Options(time_limit=20.0, progress=False)
found = control.design(data, M, control.LTI(4), setid.Noise(output=BOUND), options=options)
answer = control.stability_certificate(data, found.centre, M, 4, BOUND, delay=1)
print(answer.summary())


def draw():
    figure, ax = plt.subplots(figsize=(5.5, 3.8))
    answer.plot(ax)
    ax.grid(alpha=0.3)
    return figure


save("stability", draw)
