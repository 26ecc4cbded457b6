"""Everything of setid and of the engine that this room uses beyond public names, in one place."""

from __future__ import annotations

from types import ModuleType

import sparsepop_py as sp
from setid.data.checks import (
    FrozenMapping,
    entries_of,
    frozen,
    natural,
    number,
    real_array,
    switch,
    word,
)
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, PriorError, SetidError
from setid.feasible_points.witness import consistent, least_noise
from setid.formulation.formulation import Formulation, formulate
from setid.identify import identify
from setid.models.lti import TransferFunction
from setid.options import Options
from setid.plots.axes import new_axes
from setid.priors.base import Prior
from setid.priors.coefficients import Box, Given, parameters
from setid.priors.transfer import Stable
from setid.proofs.evidence import Verification, as_verdict
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.result.damaged_texts import refused
from setid.result.identification import Identification
from setid.result.json_ import from_json, to_json
from setid.result.json_parts import read, write
from sparsepop_py.io.json_files.codecs import parsed

__all__ = [
    "Box",
    "DataError",
    "Formulation",
    "FrozenMapping",
    "Given",
    "IOData",
    "Identification",
    "IntervalStatus",
    "ModelError",
    "Noise",
    "NoiseError",
    "Options",
    "ParameterInterval",
    "Prior",
    "PriorError",
    "SetidError",
    "Stable",
    "TransferFunction",
    "Verification",
    "as_verdict",
    "consistent",
    "entries_of",
    "formulate",
    "from_json",
    "frozen",
    "identify",
    "least_noise",
    "natural",
    "new_axes",
    "number",
    "parameters",
    "parsed",
    "python_control",
    "read",
    "real_array",
    "refused",
    "switch",
    "to_json",
    "word",
    "write",
]


def python_control(what: str) -> ModuleType:
    """Import python-control.

    Parameters
    ----------
    what : str
        The function that needs it, for the message.

    Raises
    ------
    sparsepop_py.SolverNotFound
        If it is missing; the message says how to install it.
    """
    try:
        import control
    except ImportError as error:
        raise sp.SolverNotFound(
            f"{what}: python-control is missing; install it with: "
            "pip install 'sparsepop-py[control]'"
        ) from error
    return control
