"""Guaranteed parameter intervals from measured data with bounded noise.

    data, structure, noise, priors -> formulate -> Formulation: a polynomial problem

:func:`formulate` states what the data and the noise bounds say of the parameters as a
polynomial optimization problem with named unknowns, whose proved bounds (see
:mod:`sparsepop_py`, on whose public names alone this package rests) become parameter
uncertainty intervals.

Examples
--------
>>> import setid, sparsepop_py as sp
>>> data = setid.IOData(u=[4, -3, 2, 1], y=[0, -6.25, 1.175, 2.0875])
>>> model = setid.TransferFunction(na=1, nb=1)
>>> formulation = setid.formulate(data, model, setid.Noise(equation=0.5))
>>> least = sp.solve(formulation.problem).lower_bound
>>> round(least, 5)
-0.52326
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from setid.bands.blocks import (
        SignalBand,
        StaticBand,
        signal_band,
        static_band,
    )
    from setid.bands.outputs import (
        Comparison,
        OutputBand,
        compare,
        predict,
        simulate_band,
    )
    from setid.bands.residuals import (
        Residuals,
        residuals,
    )
    from setid.bands.responses import (
        FrequencyBand,
        StepBand,
        frequency_band,
        step_band,
    )
    from setid.consistency import (
        Consistency,
        consistency,
    )
    from setid.data.noise import (
        EnergyBound,
        EstimatedBound,
        Noise,
        RateLimit,
        estimate_noise_bound,
    )
    from setid.data.record import (
        IOData,
    )
    from setid.errors import (
        DataError,
        ModelError,
        NoiseError,
        PriorError,
        SetidError,
        SetidWarning,
    )
    from setid.export.continuous import (
        ContinuousEstimate,
        to_continuous,
    )
    from setid.export.python_control import (
        ControlModels,
        to_control,
    )
    from setid.feasible_points import estimators
    from setid.feasible_points.centre import (
        Central,
        central,
        worst_case_error,
    )
    from setid.feasible_points.estimators import (
        Estimate,
        l1,
        least_squares,
        linf,
        recursive_least_squares,
    )
    from setid.feasible_points.members import (
        feasible,
        members,
        projection_estimate,
    )
    from setid.feasible_points.witness import (
        Witness,
        least_noise,
    )
    from setid.feasible_set.feasible_set import (
        FeasibleSet,
    )
    from setid.feasible_set.projections import (
        Projection,
        project,
    )
    from setid.feasible_set.sign_tree import (
        parameter_box,
    )
    from setid.formulation.assembly import (
        Rows,
    )
    from setid.formulation.formulation import (
        Formulation,
        formulate,
        to_structs,
    )
    from setid.formulation.layout import (
        Layout,
    )
    from setid.formulation.regression import (
        Regression,
    )
    from setid.identifiability.equivalence import (
        convert,
        convert_intervals,
        equivalent,
    )
    from setid.identify import (
        identify,
    )
    from setid.minimum_noise.discretisation import (
        discretisation_error,
        estimate_delta,
    )
    from setid.models.block import (
        BlockStructured,
        Hammerstein,
        HammersteinWiener,
        Lure,
        StaticMap,
        Wiener,
    )
    from setid.models.continuous import (
        ContinuousTransferFunction,
    )
    from setid.models.lti import (
        TransferFunction,
    )
    from setid.models.narx import (
        PolynomialNARX,
    )
    from setid.models.registry import (
        register_structure,
    )
    from setid.options import (
        Options,
    )
    from setid.priors import (
        Box,
        DCGain,
        Known,
        MinimumPhase,
        PoleIn,
        Sign,
        Stable,
        ZeroIn,
        parameters,
    )
    from setid.priors.registry import (
        read_prior,
        register_prior,
    )
    from setid.proofs.directions import (
        DirectionBox,
    )
    from setid.proofs.evidence import (
        Evidence,
        Verification,
    )
    from setid.proofs.intervals import (
        IntervalStatus,
        ParameterInterval,
    )
    from setid.proofs.normalisation import (
        unidentifiable,
    )
    from setid.proofs.sign_tree import (
        ParameterBox,
    )
    from setid.result.identification import (
        Identification,
    )
    from setid.select import (
        Selection,
        SelectionStep,
        select,
    )
    from setid.simulation.simulate import (
        Simulated,
        simulate,
        simulate_record,
    )
    from setid.verify import (
        verify,
    )

__all__ = [
    "BlockStructured",
    "Box",
    "Central",
    "Comparison",
    "Consistency",
    "ContinuousEstimate",
    "ContinuousTransferFunction",
    "ControlModels",
    "DCGain",
    "DataError",
    "DirectionBox",
    "EnergyBound",
    "Estimate",
    "EstimatedBound",
    "Evidence",
    "FeasibleSet",
    "Formulation",
    "FrequencyBand",
    "Hammerstein",
    "HammersteinWiener",
    "IOData",
    "Identification",
    "IntervalStatus",
    "Known",
    "Layout",
    "Lure",
    "MinimumPhase",
    "ModelError",
    "Noise",
    "NoiseError",
    "Options",
    "OutputBand",
    "ParameterBox",
    "ParameterInterval",
    "PoleIn",
    "PolynomialNARX",
    "PriorError",
    "Projection",
    "RateLimit",
    "Regression",
    "Residuals",
    "Rows",
    "Selection",
    "SelectionStep",
    "SetidError",
    "SetidWarning",
    "Sign",
    "SignalBand",
    "Simulated",
    "Stable",
    "StaticBand",
    "StaticMap",
    "StepBand",
    "TransferFunction",
    "Verification",
    "Wiener",
    "Witness",
    "ZeroIn",
    "central",
    "compare",
    "consistency",
    "convert",
    "convert_intervals",
    "discretisation_error",
    "equivalent",
    "estimate_delta",
    "estimate_noise_bound",
    "estimators",
    "feasible",
    "formulate",
    "frequency_band",
    "identify",
    "l1",
    "least_noise",
    "least_squares",
    "linf",
    "members",
    "parameter_box",
    "parameters",
    "predict",
    "project",
    "projection_estimate",
    "read_prior",
    "recursive_least_squares",
    "register_prior",
    "register_structure",
    "residuals",
    "select",
    "signal_band",
    "simulate",
    "simulate_band",
    "simulate_record",
    "static_band",
    "step_band",
    "to_continuous",
    "to_control",
    "to_structs",
    "unidentifiable",
    "verify",
    "worst_case_error",
]

# Public names are imported where they are first asked for (PEP 562): `import setid` alone loads
# no solver, no signal processing and no pictures. A test holds this table and the imports above
# to each other.
_HOMES: dict[str, tuple[str, ...]] = {
    "setid.bands.blocks": (
        "SignalBand",
        "StaticBand",
        "signal_band",
        "static_band",
    ),
    "setid.bands.outputs": (
        "Comparison",
        "OutputBand",
        "compare",
        "predict",
        "simulate_band",
    ),
    "setid.bands.residuals": (
        "Residuals",
        "residuals",
    ),
    "setid.bands.responses": (
        "FrequencyBand",
        "StepBand",
        "frequency_band",
        "step_band",
    ),
    "setid.consistency": (
        "Consistency",
        "consistency",
    ),
    "setid.data.noise": (
        "EnergyBound",
        "EstimatedBound",
        "Noise",
        "RateLimit",
        "estimate_noise_bound",
    ),
    "setid.data.record": ("IOData",),
    "setid.errors": (
        "DataError",
        "ModelError",
        "NoiseError",
        "PriorError",
        "SetidError",
        "SetidWarning",
    ),
    "setid.export.continuous": (
        "ContinuousEstimate",
        "to_continuous",
    ),
    "setid.export.python_control": (
        "ControlModels",
        "to_control",
    ),
    "setid.feasible_points.centre": (
        "Central",
        "central",
        "worst_case_error",
    ),
    "setid.feasible_points.estimators": (
        "Estimate",
        "l1",
        "least_squares",
        "linf",
        "recursive_least_squares",
    ),
    "setid.feasible_points.members": (
        "feasible",
        "members",
        "projection_estimate",
    ),
    "setid.feasible_points.witness": (
        "Witness",
        "least_noise",
    ),
    "setid.feasible_set.feasible_set": ("FeasibleSet",),
    "setid.feasible_set.projections": (
        "Projection",
        "project",
    ),
    "setid.feasible_set.sign_tree": ("parameter_box",),
    "setid.formulation.assembly": ("Rows",),
    "setid.formulation.formulation": (
        "Formulation",
        "formulate",
        "to_structs",
    ),
    "setid.formulation.layout": ("Layout",),
    "setid.formulation.regression": ("Regression",),
    "setid.identifiability.equivalence": (
        "convert",
        "convert_intervals",
        "equivalent",
    ),
    "setid.identify": ("identify",),
    "setid.minimum_noise.discretisation": (
        "discretisation_error",
        "estimate_delta",
    ),
    "setid.models.block": (
        "BlockStructured",
        "Hammerstein",
        "HammersteinWiener",
        "Lure",
        "StaticMap",
        "Wiener",
    ),
    "setid.models.continuous": ("ContinuousTransferFunction",),
    "setid.models.lti": ("TransferFunction",),
    "setid.models.narx": ("PolynomialNARX",),
    "setid.models.registry": ("register_structure",),
    "setid.options": ("Options",),
    "setid.priors": (
        "Box",
        "DCGain",
        "Known",
        "MinimumPhase",
        "PoleIn",
        "Sign",
        "Stable",
        "ZeroIn",
        "parameters",
    ),
    "setid.priors.registry": (
        "read_prior",
        "register_prior",
    ),
    "setid.proofs.directions": ("DirectionBox",),
    "setid.proofs.evidence": (
        "Evidence",
        "Verification",
    ),
    "setid.proofs.intervals": (
        "IntervalStatus",
        "ParameterInterval",
    ),
    "setid.proofs.normalisation": ("unidentifiable",),
    "setid.proofs.sign_tree": ("ParameterBox",),
    "setid.result.identification": ("Identification",),
    "setid.select": (
        "Selection",
        "SelectionStep",
        "select",
    ),
    "setid.simulation.simulate": (
        "Simulated",
        "simulate",
        "simulate_record",
    ),
    "setid.verify": ("verify",),
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "estimators":
        return import_module("setid.feasible_points.estimators")
    if name not in _MODULES:
        raise AttributeError(f"module 'setid' has no attribute {name!r}")
    found = getattr(import_module(_MODULES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Face(ModuleType):
    """A package whose functions keep their names when modules of the same name are imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and _MODULES.get(name) == value.__name__:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
