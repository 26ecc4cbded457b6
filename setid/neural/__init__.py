"""Networks trained anywhere, with statements that are proved."""

from .envelope import Envelope, envelope
from .equation_error import EquationError, equation_error
from .imports import from_arrays, from_equinox, from_jax_sysid, from_onnx, from_torch
from .last_layer import LastLayer, last_layer
from .network import Network
from .output_error import OutputError, output_error
from .recurrent import GRU, LSTM, Elman, NeuralStateSpace
from .regressor import NNARX, NNOE
from .select import NetworkSelection, select
from .simulation import SimulationBand, simulate_band
from .stability import Stability, stability
from .status import Status
from .train_proved import ProvedTraining, train_proved
from .training import Trained, initial, train

__all__ = [
    "Envelope",
    "EquationError",
    "ProvedTraining",
    "GRU",
    "LSTM",
    "LastLayer",
    "NNARX",
    "NNOE",
    "Elman",
    "Network",
    "NeuralStateSpace",
    "NetworkSelection",
    "OutputError",
    "SimulationBand",
    "Stability",
    "Status",
    "Trained",
    "envelope",
    "equation_error",
    "from_arrays",
    "from_equinox",
    "from_jax_sysid",
    "from_onnx",
    "from_torch",
    "initial",
    "last_layer",
    "output_error",
    "select",
    "simulate_band",
    "stability",
    "train",
    "train_proved",
]
