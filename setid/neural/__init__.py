"""Networks trained anywhere, with statements that are proved."""

from .contraction.stability import Stability, stability
from .imports import from_arrays, from_equinox, from_jax_sysid, from_onnx, from_torch
from .last_layers.equation_error import EquationError, equation_error
from .last_layers.last_layer import LastLayer, last_layer
from .last_layers.select import NetworkSelection, select
from .models.network import Network
from .models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from .models.regressor import NNARX, NNOE
from .simulations.output_error import OutputError, output_error
from .simulations.simulation import SimulationBand, simulate_band
from .status import Status
from .training.envelope import Envelope, envelope
from .training.train import Trained, initial, train
from .training.train_proved import ProvedTraining, train_proved

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
