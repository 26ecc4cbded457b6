"""Equations at a sample, as people write them."""

from __future__ import annotations

import numpy as np

from setid.data.noise import Noise
from setid.data.record import IOData
from setid.formulation.layout import Layout
from setid.models.equations import Equation, Lagged, channel_of

__all__ = ["equation_text"]

_NOISE = {"y": "eta", "u": "xi"}


def equation_text(
    equation: Equation, sample: int, data: IOData, layout: Layout, noise: Noise
) -> str:
    """Print one row of an equation: readings in numbers, unknowns by name.

    Parameters
    ----------
    equation : Equation
    sample : int
        Row of the data, from 0.
    data, layout, noise
        As in the formulation. Numbers are rounded to six digits.
    """
    text = ""
    for item in equation.terms:
        factors = [*item.parameters, *(_factor(s, sample, data, layout) for s in item.signals)]
        size = abs(item.coefficient)
        if size != 1.0 or not factors:
            factors.insert(0, f"{size:.6g}")
        sign = "-" if item.coefficient < 0 else "+"
        text += f" {sign} {'*'.join(factors)}"
    left = text.removeprefix(" + ").lstrip()
    width, name = 0.0, ""
    if equation.error and equation.output is not None:
        width = float(noise.bounds(data).equation[sample, equation.output])
        number = int(layout.group("e")[sample, equation.output])
        name = layout.names[number] if number >= 0 else ""
    if name:
        return f"{left} == {name}"
    return f"-{width:.6g} <= {left} <= {width:.6g}" if width else f"{left} == 0"


def _factor(lagged: Lagged, sample: int, data: IOData, layout: Layout) -> str:
    """The noise-free sample, such as ``(1.5 - eta[3])``."""
    place, signal = sample - lagged.lag, lagged.signal
    if place < data.first[sample]:
        return "0"
    found = channel_of(signal)
    if found is None and signal not in layout.groups:
        return f"{signal}[{place - data.first[sample] + 1}]"  # a known function of an input
    if found is None:
        return layout.names[int(layout.group(signal)[place])]
    letter, channel = found
    value = (data.y if letter == "y" else data.u)[place, channel]
    if np.isnan(value):
        return layout.names[int(layout.group(letter)[place, channel])]
    number = int(layout.group(_NOISE[letter])[place, channel])
    return f"({value:.6g})" if number < 0 else f"({value:.6g} - {layout.names[number]})"
