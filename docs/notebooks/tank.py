# %% [markdown]
# # The upper of two tanks: is the bend of the outflow certain?
#
# Voltage of a pump and level of the upper tank (Wigren, Uppsala; Ts = 5 s). Outflow grows with the root of the level,
# and a quadratic term stands for the bend.
#
# To repeat it beside this page: [tank.csv](../../files/examples/data/tank.csv), and the lines below.

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
    "tank.csv", inputs="u", outputs="y1", Ts=5.0
)
first, second = data.split(200)
linear = setid.PolynomialNARX(["1", "y1", "u1"], ny=1, nu=1)
bent = setid.PolynomialNARX(["1", "y1", "u1", "y1^2"], ny=1, nu=1)
for name, model in (("linear", linear), ("quadratic", bent)):
    found = setid.consistency(first, model, setid.Noise(equation=0.05))
    print(f"{name}: least bound {0.05 * found.scale[1]:.5f} V")

# %%
noise = setid.Noise(equation=1.02 * 0.05 * found.scale[1])
result = setid.identify(first, bent, noise)
print(result.table())

# %% [markdown]
# An interval without zero proves the sign of the bend, for this bound. With a larger bound it may be lost: the
# table says at which factor.

# %%
print(result.sensitivity([1.0, 1.2, 1.5]).summary())


# %%
def draw():
    return result.plot().get_figure(root=True)


_ = draw()
