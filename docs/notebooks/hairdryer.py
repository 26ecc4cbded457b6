# %% [markdown]
# # A hair dryer: what 200 samples say of a heater
#
# A fan blows air through a tube, a heater warms it (DaISy 96-006, Ts = 0.08 s). The input is the heater's voltage,
# the output the voltage of the thermocouple at the outlet. Every number called proved follows from the
# readings and the stated bound, whatever the solver did.
#
# To repeat it beside this page: [hairdryer.csv](../../files/examples/data/hairdryer.csv), and the lines below.

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
    "hairdryer.csv", inputs="u", outputs="y", Ts=0.08
)
first, second = data.split(200)
model = setid.TransferFunction(na=2, nb=2, nk=3, offset=True)
noise = setid.Noise(equation=0.11)
result = setid.identify(first, model, noise, [setid.Stable()])
print(result.table())
print("verified again, without a solver:", bool(result.verify()))

# %% [markdown]
# The intervals: proved ends in blue, attained ones in orange.

# %%
_ = result.plot()
# %% [markdown]
# All consistent models together have this frequency response. The band is proved for every frequency.

# %%
band = result.bode()
_ = band.plot()

# %% [markdown]
# The next 100 samples were not used. The band holds each reading that a consistent model allows.


# %%
def draw():
    comparison = result.compare(second, "prediction")
    return comparison.plot()[0].get_figure(root=True)


_ = draw()
