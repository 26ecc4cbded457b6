"""Draw each picture of the gallery twice, for light and for dark pages."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.colors import to_hex, to_rgba_array

PROVED, ATTAINED, OTHER = "#0072B2", "#D55E00", "#009E73"  # Okabe and Ito
FOLDER = Path(__file__).resolve().parents[2] / "docs" / "gallery"
DARK = {
    "figure.facecolor": "#1e2129",
    "axes.facecolor": "#1e2129",
    "savefig.facecolor": "#1e2129",
    "legend.facecolor": "#262a33",
    "grid.color": "#9a9fab",
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor"), "#d7dae0"),
    **dict.fromkeys(("xtick.color", "ytick.color"), "#d7dae0"),
}
LIGHTER = {"#000000": "#d7dae0", PROVED.lower(): "#56b4e9"}
COMMON = {
    "font.size": 9,
    "svg.hashsalt": "gallery",
    "svg.fonttype": "none",
    "figure.constrained_layout.use": True,
}


def save(name: str, draw: Callable[[], Any]) -> None:
    """Write ``NAME_light.svg`` and ``NAME_dark.svg``.

    Parameters
    ----------
    name : str
    draw : callable
        Draws into figures of its own and returns one.
    """
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for scheme, colours in (("light", {}), ("dark", DARK)):
        with plt.rc_context({**COMMON, **colours}):
            figure = draw()
            if scheme == "dark":
                lighten(figure)
            figure.savefig(folder / f"{name}_{scheme}.svg", metadata={"Date": None})
            plt.close("all")


def lighten(figure: Any) -> None:
    """Draw in light colours what a picture draws in black or dark blue."""
    for part in ("color", "facecolor", "edgecolor"):
        for artist in figure.findobj(lambda item, part=part: hasattr(item, f"set_{part}")):
            getter = getattr(artist, f"get_{part}", None)
            found = None if getter is None else np.atleast_2d(to_rgba_array(getter()))
            if found is None or not len(found):
                continue
            hexed = to_hex(found[0])
            if hexed in LIGHTER and found[0, 3] > 0:
                light = to_rgba_array(LIGHTER[hexed])[0]
                getattr(artist, f"set_{part}")((*light[:3], found[0, 3]))
