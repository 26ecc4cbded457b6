"""Everything of setid and of the engine that this room uses beyond public names, in one place."""

from __future__ import annotations

from types import ModuleType

import sparsepop_py as sp

from ..checks import frozen, natural, number, real_array, switch
from ..data import IOData
from ..errors import DataError, ModelError, NoiseError, SetidError
from ..existence import consistent
from ..formulation import Formulation, formulate
from ..identify import identify
from ..intervals import Identification, IntervalStatus, ParameterInterval
from ..members import attained_members
from ..models.lti import TransferFunction
from ..noise import Noise
from ..options import Options
from ..plots import new_axes
from ..priors import Box, Stable, parameters
from ..priors.base import Prior

__all__ = [
    "Box",
    "DataError",
    "Formulation",
    "IOData",
    "Identification",
    "IntervalStatus",
    "ModelError",
    "Noise",
    "NoiseError",
    "Options",
    "ParameterInterval",
    "Prior",
    "SetidError",
    "Stable",
    "TransferFunction",
    "attained_members",
    "consistent",
    "formulate",
    "frozen",
    "identify",
    "natural",
    "new_axes",
    "number",
    "parameters",
    "python_control",
    "real_array",
    "switch",
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
