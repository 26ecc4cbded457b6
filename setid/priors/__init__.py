"""Prior knowledge of the parameters: small frozen classes, freely combined.

A prior gives bounds on parameters, unknowns of its own (boxed), and rows. Strict
conditions are closed, so that what is proved about the set holds for the limit too.
"""

from setid.priors.base import Prior
from setid.priors.coefficients import Box, Given, Known, Sign, parameters
from setid.priors.physical import Physical
from setid.priors.transfer import DCGain, MinimumPhase, PoleIn, Stable, ZeroIn

__all__ = [
    "Box",
    "DCGain",
    "Given",
    "Known",
    "MinimumPhase",
    "Physical",
    "PoleIn",
    "Prior",
    "Sign",
    "Stable",
    "ZeroIn",
    "parameters",
]
