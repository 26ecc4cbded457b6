"""Networks trained anywhere, with statements that are proved."""

from .network import Network
from .recurrent import GRU, LSTM, Elman, NeuralStateSpace
from .regressor import NNARX, NNOE

__all__ = ["GRU", "LSTM", "NNARX", "NNOE", "Elman", "Network", "NeuralStateSpace"]
