# %% [markdown]
# # A heating system: the static gain, proved
#
# Voltage of a lamp and temperature of the metal below it (DaISy, Ts = 2 s). How much does a volt warm, and how long does it take?

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import setid

here = Path.cwd().resolve()
ROOT = next(p for p in (here, *here.parents) if (p / "examples" / "data").is_dir())
plt.style.use(ROOT / "docs" / "notebooks" / "site.mplstyle")

# %%
data = setid.IOData.from_csv(
    ROOT / "examples/data/heating_system.csv", inputs="u", outputs="y", Ts=2.0
)
first, second = data.split(400)
model = setid.TransferFunction(na=2, nb=2, nk=1, offset=True)
least = setid.consistency(first, model, setid.Noise(equation=1.0))
print("least equation error that explains 400 samples:", least.scale)

# %% [markdown]
# Five per cent more than the least bound is an assumption. The result lists it.

# %%
result = setid.identify(first, model, least.noise_bound(margin=1.05), [setid.Stable()])
print(result.table())

# %% [markdown]
# The step response of every consistent plant lies in the proved band.


# %%
def draw():
    return result.step(60).plot().get_figure(root=True)


_ = draw()
