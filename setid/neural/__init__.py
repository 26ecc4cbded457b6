"""Networks trained anywhere, with statements that are proved."""

from setid.neural.contraction.stability import Stability, stability
from setid.neural.imports.arrays import from_arrays
from setid.neural.imports.equinox_ import from_equinox
from setid.neural.imports.jax_sysid_ import from_jax_sysid
from setid.neural.imports.onnx_ import from_onnx
from setid.neural.imports.torch_ import from_torch
from setid.neural.last_layers.equation_error import EquationError, equation_error
from setid.neural.last_layers.last_layer import LastLayer, last_layer
from setid.neural.last_layers.select import NetworkSelection, select
from setid.neural.models.network import Network
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.models.regressor import NNARX, NNOE
from setid.neural.simulations.output_error import OutputError, output_error
from setid.neural.simulations.simulation import SimulationBand, simulate_band
from setid.neural.status import Status
from setid.neural.training.envelope import Envelope, envelope
from setid.neural.training.hidden_weights import HiddenWeights, SignChoice, hidden_weights
from setid.neural.training.smooth_weights import SmoothHiddenWeights
from setid.neural.training.train import Trained, initial, train
from setid.neural.training.train_proved import ProvedTraining, train_proved

__all__ = [
    "GRU",
    "LSTM",
    "NNARX",
    "NNOE",
    "Elman",
    "Envelope",
    "EquationError",
    "HiddenWeights",
    "LastLayer",
    "Network",
    "NetworkSelection",
    "NeuralStateSpace",
    "OutputError",
    "ProvedTraining",
    "SignChoice",
    "SimulationBand",
    "SmoothHiddenWeights",
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
    "hidden_weights",
    "initial",
    "last_layer",
    "output_error",
    "select",
    "simulate_band",
    "stability",
    "train",
    "train_proved",
]
