# %% [markdown]
# # A heating system: the static gain, proved
#
# Voltage of a lamp and temperature of the metal below it (DaISy, Ts = 2 s). How much does a volt warm, and how long does it take?
#
# To repeat it beside this page: [heating_system.csv](../../files/examples/data/heating_system.csv), and the lines below.

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
    "heating_system.csv", inputs="u", outputs="y", Ts=2.0
)
first, second = data.split(400)
model = setid.TransferFunction(na=2, nb=2, nk=1, offset=True)
least = setid.consistency(first, model, setid.Noise(equation=1.0))
print("least equation error for 400 samples:", least.scale)

# %% [markdown]
# Five per cent more than the least bound is an assumption. The result lists it.

# %%
noise = least.noise_bound(margin=1.05)
result = setid.identify(first, model, noise, [setid.Stable()])
print(result.table())

# %% [markdown]
# The step response of every consistent plant lies in the proved band.


# %%
def draw():
    return result.step(60).plot().get_figure(root=True)


_ = draw()
