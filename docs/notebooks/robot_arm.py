# %% [markdown]
# # A flexible robot arm: a resonance with proved bounds
#
# Reaction torque of the structure and acceleration of the arm (DaISy; the sampling time is not stated, 1 is used).
# The arm is lightly damped, so that models that look alike may differ at the resonance.
#
# To repeat it beside this page: [robot_arm.csv](../../files/examples/data/robot_arm.csv), and the lines below.

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
import setid

data = setid.IOData.from_csv(
    "robot_arm.csv", inputs="u", outputs="y", Ts=1.0
)
first, second = data.split(500)
model = setid.TransferFunction(na=2, nb=2, nk=1)
least = setid.consistency(first, model, setid.Noise(equation=0.1))
noise = least.noise_bound(margin=1.05)
result = setid.identify(first, model, noise)
print(result.table())

# %% [markdown]
# Where is the resonance, and how high? Between the dots the band is proved, too.

# %%
import matplotlib.pyplot as plt
import numpy as np


def draw():
    figure, ax = plt.subplots(2, sharex=True)
    result.bode(np.linspace(0.05, 3.1, 80)).plot(ax)
    return figure


_ = draw()
