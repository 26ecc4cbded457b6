"""Attained points from simulations of records, then a box from a tree of regions.

They serve cascades and long records. With an internal signal behind a map behind another block
the rows of the polynomial problem say little of the parameters until all samples of all signals are
known well. A simulation gives them from the few parameters, so that the parameters alone are
searched and split.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.errors import SetidError
from setid.feasible_points.fits.output_error import output_error_fit
from setid.feasible_points.simulations import Fitting, best_fit, reached_ends
from setid.feasible_set.simulations import SplitLimits, principal_directions, simulated_box
from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.equations import channel_of
from setid.proofs.parameter_box import ProvedBox, start_of
from setid.proofs.simulated.outputs import Recursion, recursion_of
from setid.proofs.simulated.tree import SimulatedBox
from sparsepop_py.budget import Deadline

__all__ = [
    "SimulatedEnds",
    "box_near_ends",
    "cascade_of",
    "is_cascade",
    "on_box",
    "point_of",
    "simulated_ends",
]

Reals = NDArray[np.float64]
_SHARE = 0.4  # of a tolerance: a region that reaches less far beyond an end is not split
_LEAST_WIDTH = 1e-9  # of a parameter's box: what its unit is at least


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedEnds:
    """Parameters whose simulations stay within the noise bounds.

    Parameters
    ----------
    fitting : Fitting
    best : (p,) float
        With the least noise that was found.
    level : float
        That noise, in noise bounds.
    ends : tuple of (p,) float
        Consistent, at the least and the largest value of each parameter in turn; () for none.
    """

    fitting: Fitting
    best: Reals
    level: float
    ends: tuple[Reals, ...]


def is_cascade(formulation: Formulation) -> bool:
    """Check for a structure with a map behind a block behind another map or block.

    Parameters
    ----------
    formulation : Formulation
    """
    model = formulation.model
    if not isinstance(model, BlockStructured) or formulation.products is not None:
        return False
    maps = dict(model.maps)
    sources = {name for block in model.blocks for name, _ in block.source} & set(maps)
    return any(channel_of(a) is None for name in sources for a in maps[name].arguments)


def cascade_of(formulation: Formulation, box: ProvedBox | None = None) -> Recursion | None:
    """State a cascade as a simulation; None for structures of other kinds.

    Parameters
    ----------
    formulation : Formulation
    box : ProvedBox, optional
        Of cells, where first samples of internal signals are unknown.

    Examples
    --------
    >>> import setid
    >>> shape = setid.TransferFunction(1, 1, 1)
    >>> blocks, maps = {("z", "u1"): shape, ("y1", "w"): shape}, {"w": setid.StaticMap("z", 2)}
    >>> names = ["b[z,u1]1", "gamma1"]
    >>> model = setid.BlockStructured(blocks, maps, normalise=names, initial="zero")
    >>> data = setid.IOData([1.0, -1.0, 2.0], [0.0, 0.0, 0.8])
    >>> cascade_of(setid.formulate(data, model, setid.Noise(output=0.1))).outputs
    ('y1',)
    """
    return recursion_of(formulation, box) if is_cascade(formulation) else None


def simulated_ends(
    formulation: Formulation, recursion: Recursion, box: ProvedBox | None, deadline: Deadline
) -> SimulatedEnds | None:
    """Fit simulations and go to the ends of parameters; None without a finite box.

    Parameters
    ----------
    formulation : Formulation
    recursion : Recursion
        The record as a simulation.
    box : ProvedBox or None
        Of the data; None where the bounds of priors are all that is known.
    deadline : Deadline
    """
    lower, upper = recursion.box(*_ends(formulation, box))
    if not np.all(np.isfinite([lower, upper])):
        return None
    fitting = Fitting(formulation, recursion, lower, upper)
    best, level = best_fit(fitting, deadline, _first(formulation, recursion, deadline.end))
    ends = tuple(reached_ends(fitting, best, deadline)) if level < 1.0 else ()
    return SimulatedEnds(fitting, frozen(best), level, ends)


def _first(formulation: Formulation, recursion: Recursion, until: float) -> Reals | None:
    """Fit the output errors, where a structure has measured signals only."""
    if isinstance(formulation.model, BlockStructured):
        return None
    try:
        theta, outputs = output_error_fit(formulation.data, formulation.model, until)
    except SetidError:
        return None
    past = []
    for name, known in recursion.past.items():
        channel = channel_of(name)
        assert channel is not None
        past.append(outputs[known.begin - known.lower.size : known.begin, channel[1]])
    x = np.concatenate([theta, *past])
    return x if np.all(np.isfinite(x)) else None


def on_box(found: SimulatedEnds, box: ProvedBox) -> SimulatedEnds:
    """Return the same ends, to be compared with simulations over a smaller box.

    Parameters
    ----------
    found : SimulatedEnds
    box : ProvedBox
        That holds the ends.
    """
    fitting = found.fitting
    ends = fitting.recursion.box(*_ends(fitting.formulation, box))
    return replace(found, fitting=Fitting(fitting.formulation, fitting.recursion, *ends))


def box_near_ends(
    found: SimulatedEnds,
    box: ProvedBox | None,
    tol: float,
    deadline: Deadline,
    splits: float = inf,
    near: float = inf,
) -> SimulatedBox | None:
    """Prove a box near the ends that are attained, by regions that are split.

    Parameters
    ----------
    found : SimulatedEnds
    box : ProvedBox or None
        As of :func:`simulated_ends`.
    tol : float
        Of the attained widths.
    deadline : Deadline
    splits, near : float
        As of :class:`~setid.feasible_set.simulations.SplitLimits`.
    """
    fitting, p = found.fitting, len(found.fitting.formulation.parameters)
    widths, attained = fitting.upper - fitting.lower, None
    if found.ends:
        points = np.array(found.ends)
        attained = points.min(axis=0), points.max(axis=0)
        widths = np.maximum(attained[1] - attained[0], _LEAST_WIDTH * widths)
        attained = attained[0][:p], attained[1][:p]
    slopes = fitting.errors(found.best)[1]
    if not np.all(np.isfinite(slopes)):
        return None
    directions = principal_directions(slopes, np.maximum(widths, 1e-300))
    assert not isinstance(box, SimulatedBox)
    limits = SplitLimits(attained, _SHARE * tol, deadline, splits, near)
    ends = fitting.lower, fitting.upper
    return simulated_box(
        fitting.formulation, fitting.recursion, ends, box, frozen(directions), limits
    )


def point_of(formulation: Formulation, fitting: Fitting, theta: Reals) -> Reals:
    """Complete parameters to all unknowns, by signals and noise of a simulation.

    Parameters
    ----------
    formulation : Formulation
    fitting : Fitting
    theta : (d,) float
        First samples that no equation gives follow the parameters.
    """
    signals = fitting.simulated(theta)
    outputs = np.stack([signals[name] for name in fitting.recursion.outputs], axis=1)
    y = formulation.data.y
    outputs = np.where(np.isnan(outputs) & ~np.isnan(y), y, outputs)  # what no equation asks
    known = np.where(np.isnan(y), 0.0, y - outputs)
    layout = formulation.layout
    internal = {name: values for name, values in signals.items() if name in layout.groups}
    rest = {"y": outputs, **{n: v for n, v in internal.items() if channel_of(n) is None}}
    return formulation.point(theta[: len(formulation.parameters)], output=known, signals=rest)


def _ends(formulation: Formulation, box: ProvedBox | None) -> tuple[Reals, Reals]:
    lower, upper = start_of(formulation)
    if box is None:
        return lower, upper
    return np.maximum(lower, box.lower), np.minimum(upper, box.upper)
