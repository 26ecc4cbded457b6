"""Block structures without a normalisation: why they are refused, and what is provable still.

A parameter that no equivalent vector changes has the same interval in every normalisation
that all consistent vectors have a representative in. So a normalisation is looked for that
provably excludes none: a quantity that the data prove not to be zero is set to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError
from setid.formulation.formulation import formulate
from setid.models.block import BlockStructured, Lure
from setid.priors.base import Prior
from setid.priors.checked_priors import description_of
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.parameter_box import start_of
from setid.proofs.uniqueness.normalisation import (
    Nonzero,
    loop_shift,
    normalised_by,
    priors_speak_of,
    products_with,
    takes_both_signs,
    unidentifiable,
)
from sparsepop_py.uncertain_rows.sign_tree import parameter_box

__all__ = ["Reference", "reference_model", "refuse"]


def refuse(model: BlockStructured) -> None:
    """Raise if parameters are not unique.

    Raises
    ------
    ModelError
        With the reason and the choices.
    """
    affected = unidentifiable(model)
    if not affected:
        return
    raise ModelError(
        f"normalise: found {_now(model)}, with which {', '.join(affected)} may change without "
        f"any change of the outputs: the feasible set is unbounded. {_why(model)} Expected "
        f"{_choices(model)}; or Options(unidentifiable='report') for proved intervals of the "
        "other parameters"
    )


def _now(model: BlockStructured) -> str:
    parts = [f"{name} = {value:g}" for name, value in model.fixed]
    parts += [f"static gain of {label} = 1" for label in model.unit_gain]
    return ", ".join(parts) or "none"


def _why(model: BlockStructured) -> str:
    if isinstance(model, Lure):
        return (
            "A linear part kappa*y of the map may as well belong to the linear block "
            "(a + kappa*b, gamma1 - kappa)."
        )
    names = ", ".join(model.internal)
    return f"The internal signals ({names}) have no scale: a factor may go from block to block."


def _choices(model: BlockStructured) -> str:
    if isinstance(model, Lure):
        return "normalise='nolinear' (gamma1 = 0), 'gamma1' (1), {'gamma1': value} or 'dcgain'"
    names = [n for n in unidentifiable(model) if takes_both_signs(model, n)]
    examples = " or ".join(dict.fromkeys(repr(n) for n in names[:1] + names[-1:]))
    such = f", or a parameter set to 1, such as {examples}" if examples else ""
    return f"normalise='dcgain' (static gain 1){such}"


def _settles(model: BlockStructured, name: str) -> bool:
    """Check that a parameter can be set to 1 wherever it is not zero, and that nothing is open."""
    return takes_both_signs(model, name) and not unidentifiable(normalised_by(model, name))


class Reference(NamedTuple):
    """A normalisation that every consistent system can be brought to.

    Parameters
    ----------
    model : BlockStructured
    nonzero : ParameterBox, CellBox or None
        Proof that what the normalisation sets to 1 is not zero; None for loops.
    """

    model: BlockStructured
    nonzero: Nonzero | None


def reference_model(
    data: IOData, model: BlockStructured, noise: Noise, priors: Sequence[Prior]
) -> Reference:
    """Find a normalisation that provably excludes no consistent system.

    Parameters
    ----------
    data : IOData
    model : BlockStructured
    noise : Noise
    priors : sequence of Prior

    Returns
    -------
    Reference

    Raises
    ------
    ModelError
        If none is proved to exclude no vector, or priors speak of affected parameters.
    """
    affected = set(unidentifiable(model))
    formulation = formulate(data, model, noise, priors)
    shift = loop_shift(model) if isinstance(model, Lure) else None
    changed = affected if shift is None else affected | shift.changed
    if priors_speak_of(formulation, changed):
        raise ModelError(
            f"priors: found {', '.join(map(description_of, priors))}, of which some speak "
            f"of {', '.join(sorted(changed))}; these are not unique without a normalisation: "
            "expected priors on the others alone"
        )
    if shift is not None:
        return Reference(shift.reference, None)
    rows = formulation.products
    if rows is not None:
        box = parameter_box(rows.regression, rows.start(start_of(formulation)))
        names = {formulation.parameters[i] for i in products_with(rows, box)}
        for name in sorted(names & affected, reverse=True):  # coefficients of the map first
            if _settles(model, name):
                return Reference(normalised_by(model, name), box)
    for name in model.parameters:
        if name in affected and _settles(model, name):
            other = formulate(data, normalised_by(model, name), noise, priors)
            found = cell_box(other, start_of(other), samples=False)
            if found is not None and not found.open:
                return Reference(normalised_by(model, name), found)
    raise ModelError(
        "normalise: found none, and the data prove of no parameter that it is not zero, so that "
        "each choice might exclude consistent systems; expected a normalisation"
    )
