"""Controllers straight from data, with stability that is proved.

    r, y -> target signal s = M / (1 - M) r -> identify K from y to s -> Design
    r, y, K, M -> set of consistent plants -> proof on the circle -> StabilityCertificate

Examples
--------
>>> import numpy as np, setid
>>> from setid import control
>>> M = control.reference_model(rise=4.0)
>>> plant = control.Transfer([0, 1], [1, -0.5])
>>> r = np.random.default_rng(0).uniform(-1, 1, 60)
>>> data = setid.IOData(r, plant.simulate(r))
>>> found = control.design(data, M, control.LTI(1), setid.Noise(output=1e-3))
>>> control.stability_certificate(data, found.centre, M, 1, 1e-3, delay=1).verdict
'certified'
"""

from setid.control.certificates.certificate import StabilityCertificate, stability_certificate
from setid.control.certificates.conditions import Condition
from setid.control.classes import LTI, PID, Polynomials
from setid.control.design import Design, Refuted, design
from setid.control.loops import LoopMargins, LoopStep, loop_margins, loop_step
from setid.control.references import (
    Matching,
    check_matching,
    ideal_controller,
    reference_model,
    target_signal,
)
from setid.control.report import report
from setid.control.specification import Specification, SpecifiedModel, reference_model_from
from setid.control.transfer import Transfer
from setid.control.undershoot import Undershoot, undershoot

__all__ = [
    "LTI",
    "PID",
    "Condition",
    "Design",
    "LoopMargins",
    "LoopStep",
    "Matching",
    "Polynomials",
    "Refuted",
    "Specification",
    "SpecifiedModel",
    "StabilityCertificate",
    "Transfer",
    "Undershoot",
    "check_matching",
    "design",
    "ideal_controller",
    "loop_margins",
    "loop_step",
    "reference_model",
    "reference_model_from",
    "report",
    "stability_certificate",
    "target_signal",
    "undershoot",
]
