"""Models for python-control: the one door to it.

Nominal model, vertices and a multiplicative uncertainty weight. They come from members of
the feasible set and from a grid of frequencies, so that they are labelled *sampled*: the
weight covers what was sampled, not provably the whole set.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.bands.responses import frequency_band
from setid.data.checks import frozen, word
from setid.errors import ModelError, SetidError
from setid.feasible_points.best import best
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure
from setid.simulation.responses import frequency_response, grid, transfer_of
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ControlModels", "coefficients", "to_control"]

Reals = NDArray[np.float64]
_MORE = 1.0 + 1e-14  # more than what differences, sizes and quotients are rounded by


@dataclass(frozen=True, slots=True, eq=False)
class ControlModels(ReadOnly):
    """Models of python-control that stand for an identified system.

    Parameters
    ----------
    nominal : control.TransferFunction
        Of the member that simulates the record best, else of the centre; all channels;
        discrete, or continuous where the structure is.
    vertices : tuple of control.TransferFunction
        Models of attained parameter vectors.
    weight : control.TransferFunction or None
        Stable, of order 1, with abs(G / G0 - 1) <= abs(weight) at the grid frequencies for
        every model that was looked at. None for several channels.
    omega : (F,) float
        The grid, rad per unit of time.
    radius : (F,) or (F, outputs, inputs) float
        Largest abs(G / G0 - 1) found at each frequency, of each entry where there are several
        channels.
    label : str
        ``"sampled"``, or ``"proved at the grid frequencies"``.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> bool((setid.to_control(result).radius < 1.0).all())
    True
    """

    nominal: Any
    vertices: tuple[Any, ...]
    weight: Any
    omega: Reals
    radius: Reals
    label: str

    def __repr__(self) -> str:
        largest = rounded(float(np.max(self.radius, initial=0.0)), True, 3)
        text = f"{len(self.vertices)} vertices, radius up to {largest}"
        return f"<ControlModels: {text}, {self.label}>"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the radius and the weight over the frequency; returns the axes."""
        from setid.plots.responses import plot_uncertainty

        return plot_uncertainty(self, ax)


def to_control(
    result: FeasibleSet,
    omega: ArrayLike | None = None,
    kind: Literal["sampled", "proved"] = "sampled",
    samples: int = 100,
    seed: int = 0,
) -> ControlModels:
    """Convert to models of python-control: nominal, vertices and multiplicative uncertainty weight.

    Parameters
    ----------
    result : FeasibleSet
        Of a linear structure, or of one linear block with static maps or feedback through them:
        these are left out. So is an offset: it is no part of a transfer function.
    omega : array_like (F,), optional
        Grid of frequencies.
    kind : {"sampled", "proved"}
        Where the radius comes from: members of the feasible set, or proved regions, which
        hold at the grid frequencies and say nothing between them. Proved radii are about the
        response of the nominal model as it is computed here, and rounded upwards.
    samples, seed : int
        Mixtures of attained members.

    Returns
    -------
    ControlModels

    Raises
    ------
    SolverNotFound
        If python-control is missing; the message says how to install it.
    SetidError
        If the feasible set is empty or channels have no linear block between them, or more.

    References
    ----------
    K. Zhou, J. C. Doyle, Essentials of Robust Control, 1998, section 8.2.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> models = setid.to_control(result)
    >>> models.label, len(models.vertices)
    ('sampled', 3)
    """
    check_result(result)
    word(kind, "kind", ("sampled", "proved"), SetidError)
    draws_of(samples, seed)
    control = _control()
    formulation = result.formulation
    model, Ts = formulation.model, formulation.data.Ts
    continuous = coefficients_of(model, 1, 1).continuous
    frequencies = grid(omega, Ts, continuous=continuous)
    base = 0 if continuous else Ts  # python-control's timebase
    single = model.inputs == model.outputs == 1
    if kind == "proved" and not single:
        raise ModelError(
            f"kind: found 'proved' with {model.inputs} inputs and {model.outputs} outputs, "
            "expected one of each, or kind='sampled'"
        )
    theta, label = _nominal(result), "sampled"
    if kind == "proved":
        band = frequency_band(result, frequencies, "proved")
        with np.errstate(divide="ignore", invalid="ignore"):
            around = frequency_response(model, theta, frequencies, Ts)
            radius = np.abs(band.regions - around[:, None]).max(axis=1) / np.abs(around) * _MORE
        label = "proved at the grid frequencies"
    else:
        thetas = np.vstack([theta, members(result, samples, seed)])
        radius = np.empty((frequencies.size, model.outputs, model.inputs))
        for i, j in np.ndindex(radius.shape[1:]):
            responses = frequency_response(model, thetas, frequencies, Ts, i + 1, j + 1)
            with np.errstate(divide="ignore", invalid="ignore"):
                radius[:, i, j] = np.abs(responses / responses[0] - 1.0).max(axis=0)
        radius = radius[:, 0, 0] if single else radius
    weight = None
    if single and np.all(np.isfinite(radius)):
        shape = _continuous_weight if continuous else _covering_weight
        weight = control.TransferFunction(*shape(frequencies, radius, Ts), base)
    return ControlModels(
        _transfer(control, model, theta, base),
        tuple(_transfer(control, model, t, base) for t in result.attained),
        weight,
        frozen(frequencies),
        frozen(np.asarray(radius, float)),
        label,
    )


def _nominal(result: FeasibleSet) -> Reals:
    """The member that simulates best, where one is known."""
    try:
        return best(result, "simulation").theta
    except SetidError:  # readings to start from are missing, or only the box is known
        return nominal(result)


def _control() -> ModuleType:
    try:
        import control
    except ImportError as error:
        raise sp.SolverNotFound(
            "to_control: python-control is missing; install it with: "
            "pip install 'sparsepop-py[control]'"
        ) from error
    return control


def coefficients(
    model: Structure, theta: Reals, output: int = 1, input: int = 1
) -> tuple[list[float], list[float]]:
    """List numerator and denominator in falling powers of z, or s, of equal length.

    Parameters
    ----------
    model : Structure
        Linear.
    theta : (p,) float
    output, input : int
        Channels, from 1.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid.export.python_control import coefficients
    >>> coefficients(setid.TransferFunction(1, 1, nk=2), np.array([-0.5, 3.0]))
    ([0.0, 0.0, 3.0], [1.0, -0.5, 0.0])
    """
    transfer = transfer_of(model, output, input)
    named = dict(zip(model.parameters, np.asarray(theta, float).tolist(), strict=True))
    size = max(transfer.delay + len(transfer.numerator) - 1, len(transfer.denominator)) + 1
    numerator, denominator = [0.0] * size, [1.0] + [0.0] * (size - 1)
    for lag, name in enumerate(transfer.numerator, transfer.delay):
        numerator[lag] = named[name]
    for lag, name in enumerate(transfer.denominator, 1):
        denominator[lag] = named[name]
    return numerator, denominator


def _transfer(control: ModuleType, model: Structure, theta: Reals, Ts: float) -> Any:
    pairs = [
        [coefficients(model, theta, i + 1, j + 1) for j in range(model.inputs)]
        for i in range(model.outputs)
    ]
    if model.inputs == model.outputs == 1:
        return control.TransferFunction(*pairs[0][0], Ts)
    numerators = [[pair[0] for pair in row] for row in pairs]
    return control.TransferFunction(numerators, [[pair[1] for pair in row] for row in pairs], Ts)


def _covering_weight(omega: Reals, radius: Reals, Ts: float) -> tuple[list[float], list[float]]:
    """Fit gain (1 + c q^-1) / (1 + d q^-1), stable, with the least excess over the radius in dB."""
    corners = np.concatenate([-1.0 + np.geomspace(1e-4, 1.0, 25), 1.0 - np.geomspace(0.05, 1, 8)])
    gain, c, d = _least_excess(np.exp(-1j * omega * Ts), radius, np.unique(corners).tolist())
    return [gain, gain * c], [1.0, d]


def _continuous_weight(omega: Reals, radius: Reals, Ts: float) -> tuple[list[float], list[float]]:
    """Fit gain (s + c) / (s + d) likewise, with c and d at frequencies of the grid and around."""
    corners = np.geomspace(omega.min() / 10.0, omega.max() * 10.0, 33)
    gain, c, d = _least_excess(1.0 / (1j * omega), radius, corners.tolist())
    return [gain, gain * c], [1.0, d]


def _least_excess(
    step: NDArray[np.complexfloating], radius: Reals, corners: list[float]
) -> tuple[float, float, float]:
    """gain, c, d of gain (1 + c step) / (1 + d step)."""
    floor = max(float(radius.max()), np.finfo(float).tiny) * 1e-6
    wanted = np.maximum(radius, floor)
    best: tuple[float, float, float, float] | None = None
    for c in corners:
        for d in corners:
            shape = np.abs((1.0 + c * step) / (1.0 + d * step))
            if not np.all(shape > 0):
                continue
            gain = float((wanted / shape).max()) * (1.0 + 1e-9)
            excess = float(np.mean(np.log(gain * shape / wanted)))
            if best is None or excess < best[0]:
                best = excess, gain, c, d
    assert best is not None
    return best[1:]
