"""Model structures: frozen classes that state difference equations with named parameters."""

from .continuous import ContinuousTransferFunction
from .lti import TransferFunction
from .narx import PolynomialNARX

__all__ = ["ContinuousTransferFunction", "PolynomialNARX", "TransferFunction"]
