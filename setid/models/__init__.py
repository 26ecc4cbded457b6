"""Model structures: frozen classes that state difference equations with named parameters."""

from setid.models.block import BlockStructured, Hammerstein, HammersteinWiener, Lure, Wiener
from setid.models.continuous import ContinuousTransferFunction
from setid.models.lti import TransferFunction
from setid.models.narx import PolynomialNARX

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
