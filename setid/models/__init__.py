"""Model structures: frozen classes that state difference equations with named parameters."""

from .lti import TransferFunction
from .narx import PolynomialNARX

__all__ = ["PolynomialNARX", "TransferFunction"]
