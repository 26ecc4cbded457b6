"""Model structures: frozen classes that state difference equations with named parameters."""

from .block import BlockStructured, Hammerstein, HammersteinWiener, Lure, Wiener
from .continuous import ContinuousTransferFunction
from .lti import TransferFunction
from .narx import PolynomialNARX

__all__ = [
    "BlockStructured",
    "ContinuousTransferFunction",
    "Hammerstein",
    "HammersteinWiener",
    "Lure",
    "PolynomialNARX",
    "TransferFunction",
    "Wiener",
]
