"""Compare identified models with a record: their fits, and the band of all consistent ones."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.bands.outputs import Mode, OutputBand, extent_of, predict, simulate_band
from setid.bands.verdicts import Kind
from setid.data.checks import FrozenMapping, frozen, seconds_of, word
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, SetidError
from setid.feasible_points.best import best
from setid.feasible_points.estimators import least_squares
from setid.feasible_points.members import nominal
from setid.feasible_points.modelled_outputs import fit, per_cent, predicted, simulated, started
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.minimum_noise.conflicting_samples import samples_listed
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Comparison", "compare"]

Reals = NDArray[np.float64]
_BAND = 0.75  # share of a time limit for the band beside a nominal model
_AT_REST = (
    "that rests on signals that are zero before this record (initial='zero'): where they are not, "
    "as in a part of a record, identify with initial='free'"
)
_ONE_STEP = (
    "the noise bounds are those of equation errors: they limit one-step errors, so that the set is "
    "meant for prediction; for simulation take result.best('simulation'), or bounds of the "
    "sensors (output=, input=)"
)


@dataclass(frozen=True, slots=True, eq=False)
class Comparison(ReadOnly):
    """Fit of the nominal model to a record, with the band of all consistent models.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
        The nominal model: the member that is best for the mode on the identification record,
        where one is known.
    fit : (ny,) float
        100 (1 - |y - yhat| / |y - mean y|), in per cent; 100 is perfect.
    band : OutputBand
    fits : mapping of str to (ny,) float
        The same of ``"best member"``, ``"centre"`` and ``"least squares"``, as far as they
        exist, that of the nominal model first; least squares is that of the identification record,
        whatever the noise bounds.
    advice : str
        For what an equation-error set is meant, where it is simulated; else empty.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.compare(result).theta.round(3)
    array([-0.49 ,  2.011])
    """

    names: tuple[str, ...]
    theta: Reals
    fit: Reals
    band: OutputBand
    fits: Mapping[str, Reals] = field(default_factory=dict)
    advice: str = ""

    def summary(self) -> str:
        """Describe the comparison in a few lines."""
        band = self.band
        own, *others = self.fits or [""]  # the first one is that of the nominal model
        named = f", the {own}" if own else ""
        lines = [f"fit of the nominal model{named} ({band.mode})  {per_cent(self.fit)}"]
        lines += [f"fit of {name}  {per_cent(self.fits[name])}" for name in others]
        lines.append(self._widths())
        many = len(band.reports) > 1
        for place, report in enumerate(band.reports, 1):
            lines.append(f"y{place}: {report.text}" if many else report.text)
        if band.late:
            lines.append(
                f"time was over for {band.late} ends of predictions, which are those over the "
                "outer box; a larger time_limit narrows them"
            )
        lines += self._silence()
        outside, count = len(band.outside), int(np.sum(band.tested))
        lines.append(f"readings outside the {band.kind} band of readings  {outside} of {count}")
        if outside and band.kind == "proved":
            row, output = band.outside[0].tolist()
            key = int(band.data.record[row]) + 1, row - int(band.data.first[row])
            sample = samples_listed((key,), band.data.records)
            lines.append(
                "the assumptions are falsified for this record together with the one identified "
                f"from, first by {band.data.output_names[output]} at sample {sample}: no parameter "
                "vector explains both within the noise bounds; larger bounds, a higher order or "
                "another structure is needed"
            )
        lines += [self.advice] if self.advice else []
        return "\n".join(lines)

    def _widths(self) -> str:
        """Write the mean width of each output where the band is a test."""
        band, found = self.band, list[str]()
        if not np.any(np.isfinite(band.high - band.low)):
            return f"the {band.kind} band of models is infinite: nothing is proved"
        if not np.any(np.isfinite(band.high - band.low) & ~band.silent):
            return f"the {band.kind} band of models is no test of any reading"
        names, units = band.data.output_names, band.data.output_units
        for place, (low, high) in enumerate(zip(band.low.T, band.high.T, strict=True)):
            said = np.isfinite(high - low) & ~band.silent[:, place]
            shown = f"{np.mean((high - low)[said]):.4g}" if np.any(said) else "says nothing"
            unit = f" {units[place]}" if np.any(said) and units[place] else ""
            found.append((f"{names[place]}: " if len(names) > 1 else "") + shown + unit)
        where = " where it says something" if np.any(band.silent) else ""
        return f"mean width of the {band.kind} band of models{where}  {', '.join(found)}"

    def _silence(self) -> list[str]:
        """Write at how many samples the band is no test; nothing where there are none."""
        band = self.band
        silent, count = int(np.sum(band.silent & band.tested)), int(np.sum(band.tested))
        if not silent:
            return []
        return [
            f"the band says nothing at {silent} of {count} samples: it is infinite there, or every "
            "reading of the record would lie in it"
        ]

    def __repr__(self) -> str:
        text = f"{self.band.mode}, fit {per_cent(self.fit)}, {len(self.band.outside)} readings"
        return f"<Comparison: {text} outside the {extent_of(self.band)}>"

    def plot(self, ax: Any = None) -> NDArray[Any]:
        """Draw the band with the fit in the title; returns the axes.

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One an output.
        """
        from setid.plots.outputs import plot_comparison

        return plot_comparison(self, ax)


def compare(
    result: FeasibleSet,
    validation: IOData | None = None,
    mode: Mode = "simulation",
    kind: Kind | None = None,
    noise: Noise | None = None,
    time_limit: float = 20.0,
) -> Comparison:
    """Compare the nominal model and the band of all models with a record.

    The nominal model is the consistent vector that fits the identification record best in this
    mode, where one is known. A reading outside a proved band shows that no parameter vector
    explains both records within the noise bounds.

    Parameters
    ----------
    result : FeasibleSet
    validation : IOData, optional
        The identification record when left out.
    mode : {"simulation", "prediction"}
        Outputs from the inputs alone, the default, or one step ahead from the readings before.
    kind : {"proved", "sampled"}, optional
        As in :func:`simulate_band`; bands of predictions are always proved.
    noise : Noise, optional
        Of the validation record; that of the identification when left out. Bounds that are given
        one a sample then need as many samples in both records.
    time_limit : float
        Seconds, three quarters of them for a proved band of simulations, the rest for the best
        member.

    Returns
    -------
    Comparison
        Samples from which the simulation starts do not count for the fit.

    Raises
    ------
    SetidError
        If the set is empty, or mode, kind or limit are none of these.
    DataError
        If the channels of the record are not those of the model.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = setid.compare(result)
    >>> found.fit.round(1), len(found.band.outside)
    (array([92.2]), 0)
    """
    begin, limit = time.monotonic(), seconds_of(time_limit)
    check_result(result)
    if kind is not None:
        word(kind, "kind", ("proved", "sampled"), SetidError)
    if word(mode, "mode", ("simulation", "prediction"), SetidError) == "simulation":
        band = simulate_band(result, validation, kind, noise, time_limit=_BAND * limit)
    else:
        band = predict(result, validation, noise, time_limit=_BAND * limit)
    left = max(begin + limit - time.monotonic(), (1.0 - _BAND) * limit)
    candidates = _candidates(result, mode, left)
    model, outputs_of = result.formulation.model, simulated if mode == "simulation" else predicted
    outputs = {name: outputs_of(model, t, band.data) for name, t in candidates.items()}
    fits = {name: frozen(fit(band.data.y, values)) for name, values in outputs.items()}
    chosen = next(iter(candidates))
    if chosen == "best member":
        begun = started(model, band.data)[:, None] & (mode == "simulation")
        band = replace(band, nominal=frozen(np.where(begun, band.nominal, outputs[chosen])))
    return Comparison(
        names=result.formulation.parameters,
        theta=frozen(candidates[chosen].copy()),
        fit=fits[chosen],
        band=band,
        fits=FrozenMapping(fits),
        advice="\n".join(_advice(result, mode, band, validation is not None)),
    )


def _advice(result: FeasibleSet, mode: Mode, band: OutputBand, other: bool) -> list[str]:
    """Say what a structure or its noise bounds are not meant for, where that may matter."""
    found = []
    if other and len(band.outside) and result.formulation.model.initial == "zero":
        found.append(_AT_REST)
    if mode == "simulation" and _equation_errors_alone(result):
        found.append(_ONE_STEP)
    return found


def _candidates(result: FeasibleSet, mode: Mode, time_limit: float) -> dict[str, Reals]:
    """List the parameter vectors whose fits are compared, the nominal one first."""
    found: dict[str, Reals] = {}
    try:
        found["best member"] = best(result, mode, time_limit).theta
    except SetidError:  # no member is known, or readings to start from are missing
        pass
    found["centre"] = nominal(result) if result.middle is None else result.middle
    try:
        found["least squares"] = least_squares(
            result.formulation.data, result.formulation.model
        ).theta
    except (ModelError, DataError):
        pass
    return found


def _equation_errors_alone(result: FeasibleSet) -> bool:
    """Tell whether noise acts within the equations and on no sensor."""
    eta, xi, e = result.formulation.noise.bounds(result.formulation.data)
    return bool(np.any(e > 0) and not np.any(eta > 0) and not np.any(xi > 0))
