"""Thumbnails of the notebooks: the picture that each of them draws with ``draw``."""

import os
import runpy
import sys
from pathlib import Path

from matplotlib import pyplot as plt
from style import save

NOTEBOOKS = Path(__file__).resolve().parents[2] / "docs" / "notebooks"
given = [Path(p).resolve() for p in sys.argv[1:2]]
sys.argv[1:2] = map(str, given)  # the folder is the notebooks' while they run
os.chdir(NOTEBOOKS)
for script in sorted(NOTEBOOKS.glob(f"{os.environ.get('NOTEBOOK', '*')}.py")):
    print(script.stem)
    draw = runpy.run_path(str(script))["draw"]
    plt.close("all")
    plt.rcdefaults()
    with plt.rc_context({"figure.figsize": (4.2, 2.6)}):
        save(f"notebook_{script.stem}", draw)
