"""Pictures of block structures: maps and internal signals with their bands, block diagrams."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from setid.data.digits import all_digits
from setid.errors import ModelError
from setid.models.block import BlockStructured
from setid.plots.axes import ink, new_axes, require_matplotlib
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from setid.bands.blocks import SignalBand, StaticBand
    from setid.feasible_set.feasible_set import FeasibleSet

__all__ = ["plot_diagram", "plot_signal_band", "plot_static_band"]

_PROVED, _SAMPLED = "#0072B2", "#D55E00"  # Okabe and Ito


def plot_static_band(band: StaticBand, ax: Axes | None = None) -> Axes:
    """Draw a static nonlinearity of one argument with its band.

    Parameters
    ----------
    band : StaticBand
    ax : matplotlib Axes, optional

    Raises
    ------
    ModelError
        If the map has several arguments.
    """
    if band.x.shape[1] != 1:
        raise ModelError(f"band: found a map of {len(band.arguments)} signals, expected one")
    axes = new_axes(ax)
    x, colour = band.x[:, 0], _PROVED if band.kind == "proved" else _SAMPLED
    order = np.argsort(x)
    low, high = band.low[order], band.high[order]
    axes.fill_between(x[order], low, high, color=colour, alpha=0.3, lw=0, label=band.kind)
    axes.plot(x[order], band.nominal[order], color=ink(), lw=1, label="nominal")
    axes.set_xlabel(band.arguments[0])
    axes.set_ylabel(f"{band.name} = N({band.arguments[0]})")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


def plot_signal_band(band: SignalBand, ax: Axes | None = None) -> Axes:
    """Draw an internal signal over the samples: what is proved, and what is attained.

    Parameters
    ----------
    band : SignalBand
    ax : matplotlib Axes, optional
    """
    axes = new_axes(ax)
    k = np.arange(band.low.size)
    for low, high, colour, label in (
        (band.low, band.high, _PROVED, "proved"),
        (band.sampled_low, band.sampled_high, _SAMPLED, "sampled"),
    ):
        finite = np.isfinite(low) & np.isfinite(high)
        below, above = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
        style: dict[str, Any] = {"color": colour, "alpha": 0.4, "lw": 0.5, "label": label}
        axes.fill_between(k, below, above, where=finite, **style)
    axes.set_xlabel("sample")
    axes.set_ylabel(band.name)
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


def plot_diagram(
    model: BlockStructured, result: FeasibleSet | None = None, ax: Axes | None = None
) -> Axes:
    """Draw linear blocks and static maps, their signals and their parameters.

    Parameters
    ----------
    model : BlockStructured
    result : FeasibleSet, optional
        Gives the outer intervals of the parameters.
    ax : matplotlib Axes, optional
    """
    require_matplotlib()
    if not isinstance(model, BlockStructured):
        raise ModelError(f"model: found {type(model).__name__}, expected a block structure")
    elements = _elements(model, result)
    columns = _columns(elements)
    rows: dict[int, int] = {}
    axes = new_axes(ax, (3.2 * (max(columns.values()) + 1) + 1.5, 3.2))
    places, patches = {}, {}
    for key, (_, _, text) in elements.items():
        column = columns[key]
        row = rows[column] = rows.get(column, -1) + 1
        x, y = places[key] = (3.0 * column, -2.0 * row)
        shape = {
            "boxstyle": "square,pad=0.6",
            "fc": require_matplotlib().rcParams["axes.facecolor"],
            "ec": _PROVED,
        }
        drawn = axes.text(x, y, text, ha="center", va="center", fontsize=8, bbox=shape, zorder=3)
        patches[key] = drawn.get_bbox_patch()
    used = {source for _, sources, _ in elements.values() for source, _ in sources}
    for key, (target, sources, _) in elements.items():
        x, y = places[key]
        for source, sign in sources:
            label = f"-{source}" if sign < 0 else source
            givers = [k for k, (t, _, _) in elements.items() if t == source]
            for giver in givers:
                back = columns[giver] >= columns[key]
                _arrow(axes, places[giver], (x, y), label, (patches[giver], patches[key]), back)
            if not givers:
                _arrow(axes, (x - 2.2, y), (x, y), label, (None, patches[key]))
        if target not in used or target[0] == "y":
            height = y + (0.5 if target in used else 0.0)
            _arrow(axes, (x, height), (x + 2.2, height), target, (patches[key], None))
    axes.set_xlim(-2.6, 3.0 * max(columns.values()) + 2.6)
    axes.set_ylim(-2.0 * max(rows.values()) - 1.8, 1.4)
    axes.set_axis_off()
    return axes


Element = tuple[str, tuple[tuple[str, float], ...], str]


def _elements(model: BlockStructured, result: FeasibleSet | None) -> dict[str, Element]:
    """Target, sources and text of each block and each map."""
    found: dict[str, Element] = {}
    for name, item in model.maps:
        lines = [f"{name} = N({', '.join(item.arguments)})"]
        for m, weight in enumerate(model.wiring.weights(name)):
            lines.append(f"{item.text(m)}: {_value(model, result, weight)}")
        found[f"map {name}"] = (name, tuple((a, 1.0) for a in item.arguments), "\n".join(lines))
    for block in model.blocks:
        transfer = model.wiring.transfer(block)
        names = (*transfer.denominator, *transfer.numerator)
        lines = [
            f"{block.target} = G({block.source_text})",
            *(_value(model, result, n) for n in names),
        ]
        found[block.label] = (block.target, block.source, "\n".join(lines))
    return found


def _value(model: BlockStructured, result: FeasibleSet | None, name: str) -> str:
    fixed = dict(model.fixed)
    if name in fixed:
        return f"{name} = {all_digits(fixed[name])}"
    if result is None or name not in result.intervals:
        return name
    low, high = result.intervals[name].outer
    return f"{name} in [{rounded(low, False, 4)}, {rounded(high, True, 4)}]"


def _columns(elements: dict[str, Element]) -> dict[str, int]:
    """Count the elements between the inputs and each of them, loops left out."""
    found: dict[str, int] = {}
    for _ in elements:
        for key, (_, sources, _) in elements.items():
            before = [
                found[k] for k, (t, _, _) in elements.items() if t in dict(sources) and k in found
            ]
            outside = any(all(t != s for t, _, _ in elements.values()) for s in dict(sources))
            if key not in found and (outside or before):
                found[key] = 0 if outside else 1 + max(before)
    return {key: found.get(key, 0) for key in elements}


def _arrow(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    label: str,
    patches: tuple[Any, Any],
    back: bool = False,
) -> None:
    """An arrow between boxes (None: the outside), bent below them where it goes back."""
    style = {
        "arrowstyle": "->",
        "color": ink(),
        "connectionstyle": "arc3,rad=-0.5" if back else "arc3,rad=0",
        "patchA": patches[0],
        "patchB": patches[1],
        "shrinkA": 0,
        "shrinkB": 1,
    }
    axes.annotate("", xy=end, xytext=start, arrowprops=style, zorder=1)
    share = 0.85 if patches[0] is None else 0.5
    share = 0.25 if patches[1] is None else share
    x, y = ((1 - share) * e + share * s for s, e in zip(start, end, strict=True))
    axes.text(x, y - 1.1 if back else y + 0.1, label, ha="center", fontsize=9, zorder=4)
