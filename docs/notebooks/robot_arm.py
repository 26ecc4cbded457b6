# %% [markdown]
# # A flexible robot arm: a resonance with proved bounds
#
# Reaction torque of the structure and acceleration of the arm (DaISy; the sampling time is not stated, 1 is used).
# The arm is lightly damped, so that models that look alike may differ at the resonance.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import setid

here = Path.cwd().resolve()
ROOT = next(p for p in (here, *here.parents) if (p / "examples" / "data").is_dir())
plt.style.use(ROOT / "docs" / "notebooks" / "site.mplstyle")

# %%
data = setid.IOData.from_csv(ROOT / "examples/data/robot_arm.csv", inputs="u", outputs="y", Ts=1.0)
first, second = data.split(500)
model = setid.TransferFunction(na=2, nb=2, nk=1)
least = setid.consistency(first, model, setid.Noise(equation=0.1))
result = setid.identify(first, model, least.noise_bound(margin=1.05))
print(result.table())

# %% [markdown]
# Where is the resonance, and how high? Between the dots the band is proved, too.

# %%
import numpy as np


def draw():
    figure, ax = plt.subplots(2, sharex=True)
    result.bode(np.linspace(0.05, 3.1, 80)).plot(ax)
    return figure


_ = draw()
