# %% [markdown]
# # A buck converter: a polynomial model and what it predicts
#
# Duty cycle and output voltage of a DC-DC converter (Ts = 10 microseconds, 1001 samples for estimation, 999 for
# validation).
#
# To repeat it beside this page: [buck_id.csv](../../files/examples/data/buck_id.csv) and [buck_valid.csv](../../files/examples/data/buck_valid.csv), and the lines below.

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
import numpy as np

import setid

data, validation = (
    setid.IOData.from_csv(f"buck_{part}.csv", "u", "y", 1e-5)
    for part in ("id", "valid")
)
model = setid.PolynomialNARX(
    ["1", "y1", "y2", "u1", "u1^2"], ny=2, nu=1
)
least = setid.consistency(data, model, setid.Noise(equation=1.0))
result = setid.identify(data, model, least.noise_bound(margin=1.2))
print(result.table())

# %% [markdown]
# The validation record was not used. Readings outside of the proved band would falsify the bound.

# %%
comparison = result.compare(validation, "prediction")
print(comparison.summary())


def draw():
    first = result.compare(validation.split(200)[0], "prediction")
    return np.ravel(first.plot())[0].get_figure(root=True)


_ = draw()
