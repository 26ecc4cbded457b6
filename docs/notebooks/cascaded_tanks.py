# %% [markdown]
# # Cascaded tanks: a network with a proved last layer
#
# Pump voltage and level of the lower tank (benchmark of nonlinear identification, Ts = 4 s). A small network is trained
# by SciPy. All last layers that explain the record are then enclosed.
#
# To repeat it beside this page: [cascaded_tanks.csv](../../files/examples/data/cascaded_tanks.csv), and the lines below.

# %% tags=["setup"]
import os
from pathlib import Path

import matplotlib.pyplot as plt

here = Path.cwd().resolve()
ROOT = next(
    p
    for p in (here, *here.parents)
    if (p / "examples" / "data").is_dir()
)
plt.style.use(ROOT / "docs" / "notebooks" / "site.mplstyle")
os.chdir(ROOT / "examples" / "data")

# %%
import matplotlib.pyplot as plt
import numpy as np

import setid
from setid import neural

path = "cascaded_tanks.csv"
data, validation = (
    setid.IOData.from_csv(path, f"u_{part}", f"y_{part}", 4.0)
    for part in ("est", "val")
)
validation = validation.split(300)[0]
net = neural.train(neural.initial(data, order=3, widths=[2]), data).net
layer = neural.last_layer(net, data, factor=1.5)
for item in layer.intervals.values():
    print(item)

# %% [markdown]
# The bound is 1.5 times the least equation error, an assumption. Readings outside of the band would falsify it.

# %%
band = layer.band(validation)
print(
    len(band.outside),
    "of",
    validation.samples,
    "validation readings outside",
)


def draw():
    figure, ax = plt.subplots()
    time = 4.0 * np.arange(validation.samples)
    ax.fill_between(
        time,
        band.low[:, 0],
        band.high[:, 0],
        color="#0072B2",
        alpha=0.35,
        lw=0,
    )
    ax.plot(time, validation.y[:, 0], color="#D55E00", lw=1)
    ax.set(xlabel="time (s)", ylabel="level (V)")
    return figure


_ = draw()
