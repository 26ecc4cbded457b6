"""Names of setid, and where they come from; loaded with their first use."""

from . import control, neural
from .analysis.advise import (
    Advice,
    Excitation,
    advise,
    excitation,
)
from .analysis.fit import (
    Fit,
    fit,
)
from .analysis.recursive import (
    Recursive,
    UpdateCost,
)
from .analysis.reparametrise import (
    Reparametrisation,
    reparametrise,
)
from .analysis.select import (
    Selection,
    SelectionStep,
    select,
)
from .analysis.sensitivity import (
    Sensitivity,
    sensitivity,
)
from .analysis.terms import (
    sparse_terms,
)
from .bands.blocks import (
    SignalBand,
    StaticBand,
    signal_band,
    static_band,
)
from .bands.comparison import (
    Comparison,
    compare,
)
from .bands.outputs import (
    OutputBand,
    predict,
    simulate_band,
)
from .bands.residuals import (
    Residuals,
    residuals,
)
from .bands.responses import (
    FrequencyBand,
    frequency_band,
)
from .bands.steps import (
    StepBand,
    step_band,
)
from .bands.verdicts import (
    BandReport,
)
from .consistency import (
    consistency,
)
from .data.noise import (
    EnergyBound,
    EstimatedBound,
    Noise,
    RateLimit,
    estimate_noise_bound,
)
from .data.record import (
    IOData,
)
from .errors import (
    DataError,
    EmptySetError,
    ModelError,
    NoiseError,
    PriorError,
    SetidError,
    SetidWarning,
)
from .export.continuous import (
    ContinuousEstimate,
    to_continuous,
)
from .export.matlab_files import (
    to_mat,
    to_ureal,
)
from .export.python_control import (
    ControlModels,
    to_control,
)
from .feasible_points import estimators
from .feasible_points.best import (
    BestMember,
    best,
)
from .feasible_points.centre import (
    Central,
    central,
    worst_case_error,
)
from .feasible_points.estimators import (
    Estimate,
    l1,
    least_squares,
    linf,
    recursive_least_squares,
)
from .feasible_points.members import (
    feasible,
    members,
    projection_estimate,
)
from .feasible_points.witness import (
    Witness,
    least_noise,
)
from .feasible_set.feasible_set import (
    FeasibleSet,
)
from .feasible_set.projections import (
    Projection,
    project,
)
from .feasible_set.start import (
    parameter_box,
)
from .formulation.assembly import (
    Rows,
)
from .formulation.formulation import (
    Formulation,
    formulate,
    to_structs,
)
from .formulation.layout import (
    Layout,
)
from .formulation.regression import (
    Regression,
)
from .identifiability.equivalence import (
    convert,
    convert_intervals,
    equivalent,
)
from .identify import (
    identify,
)
from .minimum_noise.consistency_result import (
    Consistency,
)
from .minimum_noise.discretisation import (
    discretisation_error,
    estimate_delta,
)
from .models.block import (
    BlockStructured,
    Hammerstein,
    HammersteinWiener,
    Lure,
    StaticMap,
    Wiener,
)
from .models.continuous import (
    ContinuousTransferFunction,
)
from .models.lti import (
    TransferFunction,
)
from .models.narx import (
    PolynomialNARX,
)
from .models.registry import (
    register_structure,
)
from .options import (
    Options,
)
from .priors import (
    Box,
    DCGain,
    Known,
    MinimumPhase,
    Physical,
    PoleIn,
    Sign,
    Stable,
    ZeroIn,
    parameters,
)
from .priors.registry import (
    read_prior,
    register_prior,
)
from .proofs.evidence import (
    Evidence,
    Verification,
)
from .proofs.intervals import (
    IntervalStatus,
    ParameterInterval,
)
from .proofs.parameter_box import (
    DirectionBox,
    ParameterBox,
)
from .proofs.uniqueness.normalisation import (
    unidentifiable,
)
from .result.identification import (
    Identification,
)
from .simulation.simulate import (
    Simulated,
    simulate,
    simulate_record,
)
from .study import (
    Study,
)
from .verify import (
    verify,
)

__version__: str

__all__ = [
    "Advice",
    "BestMember",
    "BlockStructured",
    "Box",
    "BandReport",
    "Central",
    "Comparison",
    "Consistency",
    "ContinuousEstimate",
    "ContinuousTransferFunction",
    "ControlModels",
    "DCGain",
    "DataError",
    "DirectionBox",
    "EmptySetError",
    "EnergyBound",
    "Estimate",
    "EstimatedBound",
    "Evidence",
    "Excitation",
    "FeasibleSet",
    "Fit",
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
    "Physical",
    "PoleIn",
    "PolynomialNARX",
    "PriorError",
    "Projection",
    "RateLimit",
    "Recursive",
    "Regression",
    "Reparametrisation",
    "Residuals",
    "Rows",
    "Selection",
    "SelectionStep",
    "Sensitivity",
    "SetidError",
    "SetidWarning",
    "Sign",
    "SignalBand",
    "Simulated",
    "Stable",
    "StaticBand",
    "StaticMap",
    "StepBand",
    "Study",
    "TransferFunction",
    "UpdateCost",
    "Verification",
    "Wiener",
    "Witness",
    "ZeroIn",
    "advise",
    "best",
    "central",
    "compare",
    "consistency",
    "control",
    "convert",
    "convert_intervals",
    "discretisation_error",
    "equivalent",
    "estimate_delta",
    "estimate_noise_bound",
    "estimators",
    "excitation",
    "feasible",
    "fit",
    "formulate",
    "frequency_band",
    "identify",
    "l1",
    "least_noise",
    "least_squares",
    "linf",
    "members",
    "neural",
    "parameter_box",
    "parameters",
    "predict",
    "project",
    "projection_estimate",
    "read_prior",
    "recursive_least_squares",
    "register_prior",
    "register_structure",
    "reparametrise",
    "residuals",
    "select",
    "sensitivity",
    "signal_band",
    "simulate",
    "simulate_band",
    "simulate_record",
    "sparse_terms",
    "static_band",
    "step_band",
    "to_continuous",
    "to_control",
    "to_mat",
    "to_structs",
    "to_ureal",
    "unidentifiable",
    "verify",
    "worst_case_error",
]
