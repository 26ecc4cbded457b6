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

from setid.bands.blocks import SignalBand, StaticBand, signal_band, static_band
from setid.bands.outputs import Comparison, OutputBand, compare, predict, simulate_band
from setid.bands.residuals import Residuals, residuals
from setid.bands.responses import FrequencyBand, StepBand, frequency_band, step_band
from setid.consistency import Consistency, consistency
from setid.data.noise import EnergyBound, EstimatedBound, Noise, RateLimit, estimate_noise_bound
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, PriorError, SetidError, SetidWarning
from setid.export.continuous import ContinuousEstimate, to_continuous
from setid.export.python_control import ControlModels, to_control
from setid.feasible_points import estimators
from setid.feasible_points.centre import Central, central, worst_case_error
from setid.feasible_points.estimators import (
    Estimate,
    l1,
    least_squares,
    linf,
    recursive_least_squares,
)
from setid.feasible_points.members import feasible, members, projection_estimate
from setid.feasible_set.projections import Projection, project
from setid.feasible_set.sign_tree import parameter_box
from setid.formulation.assembly import Rows
from setid.formulation.completion import Witness
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.layout import Layout
from setid.formulation.regression import Regression
from setid.identifiability.equivalence import convert, convert_intervals, equivalent, unidentifiable
from setid.identify import identify
from setid.minimum_noise.discretisation import discretisation_error, estimate_delta
from setid.models.block import (
    BlockStructured,
    Hammerstein,
    HammersteinWiener,
    Lure,
    StaticMap,
    Wiener,
)
from setid.models.continuous import ContinuousTransferFunction
from setid.models.lti import TransferFunction
from setid.models.narx import PolynomialNARX
from setid.options import Options
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
from setid.proofs.directions import DirectionBox
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.sign_tree import ParameterBox
from setid.proofs.verification import Verification
from setid.result.identification import Identification
from setid.select import Selection, SelectionStep, select
from setid.simulation.simulate import Simulated, simulate, simulate_record

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
    "least_squares",
    "linf",
    "members",
    "parameter_box",
    "parameters",
    "predict",
    "project",
    "projection_estimate",
    "recursive_least_squares",
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
    "unidentifiable",
    "worst_case_error",
]
