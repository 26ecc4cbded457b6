"""Putting results of identification together, and what is said where nothing is found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.identifiability.common_factor import Endless
from setid.models.block import BlockStructured, HammersteinWiener, Wiener
from setid.options import Options
from setid.proofs.base import Bounds
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.result.identification import Identification
from setid.result.reports import active_priors

__all__ = ["empty_result", "endless_text", "free_text", "result_of", "unbounded_text"]


def result_of(
    formulation: Formulation,
    settings: Options,
    timings: Mapping[str, float],
    intervals: Sequence[ParameterInterval],
    **parts: Any,
) -> Identification:
    """All parts of a result, put together."""
    points = [w for item in intervals for w in item.witnesses if w is not None]
    parts.setdefault("box", None)
    parts.setdefault("problem", formulation.problem)
    return Identification(
        formulation=formulation,
        intervals=MappingProxyType({item.name: item for item in intervals}),
        assumptions=formulation.assumptions,
        options=settings,
        active=MappingProxyType(active_priors(formulation, points) if points else {}),
        timings=MappingProxyType(dict(timings)),
        **parts,
    )


def empty_result(
    formulation: Formulation,
    settings: Options,
    timings: Mapping[str, float],
    box: Bounds | None = None,
    **parts: Any,
) -> Identification:
    """The result of a feasible set that is proved empty."""
    status = IntervalStatus.EMPTY
    items = [ParameterInterval(n, (inf, -inf), None, status) for n in formulation.parameters]
    parts["notes"] = (*parts.get("notes", ()), *_exactness(formulation))
    return result_of(formulation, settings, timings, items, box=box, **parts)


def _exactness(formulation: Formulation) -> list[str]:
    """Readings are rounded, so noise of exactly zero is almost never consistent."""
    if any(np.any(bound > 0) for bound in formulation.noise.bounds(formulation.data)):
        return []
    y = formulation.data.y
    size = float(np.nanmax(np.abs(y))) * 2.0**-50
    return [
        "readings are rounded, so that no parameters explain them with noise of exactly zero: give "
        "bounds of the errors, output= and input= of the sensors or equation= of the model "
        "(setid.consistency finds the least that explain the record); of an exact simulation the "
        f"rounding alone, Noise(equation={size:.1e})"
    ]


def unbounded_text(formulation: Formulation, loose: NDArray[np.int64]) -> str:
    """Which parameters the data leave unbounded, and what bounds them."""
    names = ", ".join(formulation.parameters[i] for i in loose)
    model = formulation.model
    if isinstance(model, BlockStructured) and formulation.products is None:
        first = " and initial='zero'" if model.initial == "free" else ""
        return (
            f"the data give no finite bounds of {names}: the outputs are no sums of products of "
            f"measured signals; give Box for {names}"
            + (f", or Stable{first}" if isinstance(model, Wiener | HammersteinWiener) else "")
        )
    return (
        f"the data give no finite bounds of {names}: the noise is strong for this input; give "
        "a prior such as Box or Stable, a longer record, or more excitation"
    )


def free_text(free: tuple[str, ...]) -> tuple[str, ...]:
    """What is said where noise alone explains the record."""
    if not free:
        return ()
    return (
        "noise within its bounds explains the whole record without any system: nothing is learnt "
        f"of {', '.join(free)}; excite more strongly, or lower the noise bounds",
    )


def endless_text(endless: Endless) -> tuple[str, ...]:
    """What is said where a simpler structure makes parameters unbounded."""
    simpler = endless.model
    return (
        f"the data give no finite bounds of {', '.join(endless.names)}, proved: {simpler!r} with a "
        "pole less explains the data as well, and nothing limits the pole that is added to it; "
        "take the lower order, less noise, more excitation, or a prior such as Stable",
    )
