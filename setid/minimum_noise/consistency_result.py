"""The result of :func:`setid.consistency`: the least noise that explains the data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import number
from setid.data.digits import all_digits
from setid.data.noise import EstimatedBound, Noise
from setid.errors import NoiseError, SetidError
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import DRIVEN, LIFTED
from setid.html import listing, section, table
from setid.minimum_noise.conflicting_samples import samples_listed
from setid.models.continuous import ContinuousTransferFunction
from setid.models.lti import TransferFunction
from setid.proofs.evidence import Verification, as_verdict
from setid.proofs.least_noise.noise_scale import NoiseScale, stated_at, verify_scale
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["READ_OFF", "Consistency", "assumptions_of", "ends_of"]

Reals = NDArray[np.float64]

READ_OFF = "read off this record"
_MULTIPLIED = (
    "denominators are multiplied out, which keeps every consistent parameter vector; the attained "
    "factor may be that of one whose denominators have a common zero"
)
_DRIVEN = "an offset drives the equation: it is that of the output times the denominators at q = 1"
_ROUNDING = 2.0**-50


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Consistency(NoiseScale):
    """The least factor on all noise bounds with which the data are consistent.

    Parameters
    ----------
    scale : (float, float)
        No parameters are consistent with a factor below ``scale[0]`` (proved), some are with
        ``scale[1]`` (attained; infinite where none was found).
    theta : (p,) float or None
        Parameters of ``formulation`` that attain the upper end.
    witness : (n,) float or None
        All unknowns of ``formulation`` there, noise included, as they were found: ``verify`` proves
        again that ``theta`` attains the upper end, and does not look at the others.
    formulation : Formulation
        The data with noise bounds at the largest factor that was looked at.
    limit : float
        That factor.
    problem : sparsepop_py.Problem
        Whose last variable is the factor, as a fraction of ``limit``.
    bound : sparsepop_py.LinearBound or None
        The exact optimum, where the problem is linear.
    result : sparsepop_py.Result or None
        What the engine proved, otherwise.
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
        The box of the parameters with the factor at ``limit``.
    refuted : (float, ParameterBox or DenominatorCells) or None
        A factor at which no parameters are proved to be consistent, by rows or by denominators.
    noise : Noise
        As given: a factor of 1.
    assumptions : tuple of str
    samples : tuple of (record, sample)
        Records, from 1, and samples, from 0, that keep the factor from being smaller than the
        lower end, or than ``refuted`` where there is one; empty where linear programs do not tell.
        ``verify`` does not look at them.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.consistency(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> round(0.5 * found.scale[0], 6), found.explains
    (0.339028, True)
    """

    assumptions: tuple[str, ...]
    samples: tuple[tuple[int, int], ...]

    def is_within(self, tol: float) -> bool:
        """Check that the ends are within a share of the upper one of each other.

        Parameters
        ----------
        tol : float

        Raises
        ------
        SetidError
            If that is no number.
        """
        share = number(tol, "tol", SetidError)
        return self.scale[0] >= (1.0 - share) * self.scale[1]

    def noise_bound(self, margin: float = 1.0) -> Noise:
        """Read noise bounds off this record: the attained factor times the bounds as given.

        Bounds that are one a channel, or shares of readings, stay so and fit another record.

        A model error ``delta`` counts as output noise: what is left of that beyond ``delta`` as
        given is returned, for identification with the same structure.

        Parameters
        ----------
        margin : float
            Factor >= 1 on the least: another record of the system may need more.

        Returns
        -------
        Noise
            Which says in its ``assumptions`` where it comes from; results repeat that.

        Raises
        ------
        NoiseError
            If no factor is attained, or the margin is below 1.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        >>> found = setid.consistency(data, setid.TransferFunction(1, 1), setid.Noise(equation=1))
        >>> noise = found.noise_bound(1.05)
        >>> noise.equation.round(4), noise.assumptions[0][:35]
        (array([0.356]), 'equation noise: read off this recor')
        """
        factor = number(margin, "margin", NoiseError)
        if not 1.0 <= factor < inf:
            raise NoiseError(f"margin: found {margin!r}, expected a factor >= 1")
        if not self.scale[1] < inf:
            raise NoiseError("scale: found no attained factor, expected one to read a bound off")
        text = f"{READ_OFF} ({all_digits(factor)} times the least bound that explains it)"
        data, noise, error = self.formulation.data, self.noise, self.noise.model_error
        if error:
            text += f", beyond delta = {all_digits(error)}"
            if noise.relative:  # beside delta they are no shares of the readings
                noise = Noise(*noise.covering(0.0).bounds(data))
        kept: dict[str, Any] = {"relative": noise.relative}
        channels = {"output": data.outputs, "input": data.inputs, "equation": data.outputs}
        for kind, count in channels.items():
            given = np.asarray(getattr(noise, kind), np.float64)
            values = _times(given, factor * self.scale[1], error if kind == "output" else 0.0)
            if noise.relative:  # products with readings are rounded up, once more or less
                values = values * (1.0 + _ROUNDING)
            if np.any(values > 0):
                values = np.full(count, values) if values.ndim == 0 else values
                kept[kind] = EstimatedBound(values, np.zeros(count), text)
        return Noise(**kept)

    @as_verdict
    def verify(self) -> Verification:
        """Check both ends and the assumptions again, without any solver."""
        verdict = verify_scale(self)
        if verdict and self.assumptions != assumptions_of(stated_at(self, self.limit), self.noise):
            return Verification(False, "the assumptions are not those of the data and the noise")
        return verdict

    def summary(self) -> str:
        """Describe the factor and what it rests on in a few lines."""
        lines = [f"least factor on {self.noise.scaled}: {ends_of(self.scale, 6)}"]
        lines.append(_MEANING[self.explains])
        if self.theta is not None:
            pairs = zip(_names(self.formulation), self.theta.tolist(), strict=True)
            lines.append("attained by " + ", ".join(f"{n} = {v:.6g}" for n, v in pairs))
        if self.samples:
            shown = samples_listed(self.samples, self.formulation.data.records)
            lines.append(f"held up by samples {shown}{self._beside()}")
        lines += ["taken for granted:", *(f"- {text}" for text in self.assumptions)]
        return "\n".join(lines)

    def _beside(self) -> str:
        """Say how far the samples alone hold up the factor, where all others raise it."""
        alone = self.scale[0] if self.refuted is None else self.refuted[0]
        if alone >= self.scale[0]:
            return ""
        return f", which alone refute factors below {rounded(alone, False, 6)}"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the refuted and attained factors; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_consistency

        return plot_consistency(self, ax)

    def _repr_html_(self) -> str:
        low = rounded(self.scale[0], False, 6)
        high = rounded(self.scale[1], True, 6) if self.scale[1] < inf else "none"
        return section(
            _MEANING[self.explains],
            table(["", "proved", "attained"], [[f"factor on {self.noise.scaled}", low, high]]),
            listing("taken for granted", self.assumptions),
        )

    def __repr__(self) -> str:
        return f"<Consistency: factor {ends_of(self.scale, 6)}>"


def assumptions_of(formulation: Formulation, noise: Noise) -> tuple[str, ...]:
    """List what a least factor rests on.

    Parameters
    ----------
    formulation : Formulation
    noise : Noise
        As given: a factor of 1.
    """
    model, texts = formulation.model, [*noise.assumptions, *formulation.assumptions]
    if noise.model_error and isinstance(model, ContinuousTransferFunction):  # with delta as noise
        given = replace(model, delta=noise.model_error)
        said = {f"the system is a {model!r}": f"the system is a {given!r}"}
        said[model.between_samples(0.0)] = given.between_samples(noise.model_error)
        texts = [said.get(text, text) for text in texts]
    if isinstance(model, TransferFunction) and model.form == DRIVEN:
        texts.append(_DRIVEN)
    if isinstance(model, TransferFunction) and model.form in (LIFTED, DRIVEN):
        texts.append(_MULTIPLIED)
    return tuple(dict.fromkeys(texts))


def ends_of(scale: tuple[float, float], digits: int) -> str:
    """Write a least factor between its proved and its attained end.

    Parameters
    ----------
    scale : (float, float)
    digits : int
    """
    low, high = scale
    if low == inf:
        return "none, however large (proved)"
    ends = f"{rounded(low, False, digits)} (proved)"
    if high == inf:
        return f"{ends}, none found that is attained"
    return f"{ends} to {rounded(high, True, digits)} (attained)"


def _times(bound: Reals, factor: float, error: float) -> Reals:
    """Multiply bounds, an error beside them included, and take that off again; rounded up."""
    whole = np.nextafter(bound + error, inf) if error else bound
    more = np.nextafter(whole * factor, inf)
    left = np.maximum(np.nextafter(more - error, inf), 0.0) if error else more
    return np.where(whole > 0, left, 0.0)


_MEANING = {
    True: "the noise bounds explain the data: consistent parameters exist",
    False: "the noise bounds are too small for this structure: no parameters are consistent",
    None: "whether the noise bounds explain the data is open: give more time",
}


def _names(formulation: Formulation) -> list[str]:
    """Name the parameters for people: offsets that drive equations are not those of outputs."""
    model, offsets = formulation.model, tuple[str, ...]()
    if isinstance(model, TransferFunction) and model.form == DRIVEN:
        offsets = model.offsets()
    return [f"{n} of the equation" if n in offsets else n for n in formulation.parameters]
