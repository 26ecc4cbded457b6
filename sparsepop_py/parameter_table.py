"""The table of every field of SparsePOP 3.03's ``param``, and what each does here.

It drives the conversion in :mod:`sparsepop_py.parameters`, and the documentation shows
what :func:`render_table` makes of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["FIELDS", "Field", "render_table"]

_SWITCH = (0, 1)


@dataclass(frozen=True)
class Field:
    """One field of ``param``.

    Parameters
    ----------
    name : str
    default : object
        Of SparsePOP 3.03 (of this package for a field that the original lacks).
    effect : {"works", "later", "none"}
        It works; it is accepted and will work later; it has no meaning here.
    option : str
        The option of :class:`~sparsepop_py.options.Options` it sets, or ``""``.
    note_on_proof : str
        What it changes in what is proved.
    legal : tuple
        The legal values of a switch; empty when other values are legal too.
    """

    name: str
    default: Any
    effect: Literal["works", "later", "none"]
    option: str
    note_on_proof: str
    legal: tuple[Any, ...] = ()


_MULTIPLIERS = "None: it only chooses the multipliers, and any multipliers prove a bound."

FIELDS: tuple[Field, ...] = (
    Field(
        "relaxOrder",
        1,
        "works",
        "order",
        "A higher order can only prove more. Raised to the least legal order; a fraction is "
        "rounded up.",
    ),
    Field(
        "sparseSW",
        1,
        "works",
        "sparse",
        "0 makes one clique of all variables, which can prove more and costs more. 2 and 3, "
        "the original's perturbed variants, are treated as 0 and 1.",
        (0, 1, 2, 3),
    ),
    Field(
        "POPsolver",
        "",
        "works",
        "refine",
        "None: it fills the fields `xVectL` to `scaledErrorL`. `'ipopt'` chooses IPOPT, any "
        "other name SciPy.",
    ),
    Field(
        "printLevel",
        (2, 0),
        "works",
        "progress",
        "None. 0 is silent, 1 leaves out the solution vector. The second number (a file) has "
        "no effect yet.",
    ),
    Field(
        "tighten",
        1,
        "works",
        "effort",
        'Not in the original. 1 is `"presolve"`: finite boxes by propagation and by the '
        'attained value, each step part of the certificate. 0 is `"plain"`: the bounds as '
        "given; without finite ones often nothing can be proved.",
        _SWITCH,
    ),
    Field(
        "SDPsolver",
        "sedumi",
        "works",
        "solver",
        "None: the bound is recomputed from whatever multipliers a solver returns. The "
        "original's six solvers are replaced by `'auto'`; `'auto'`, `'clarabel'`, "
        "`'clarabel-moment'`, `'cliquetree'` and `'cvxpy:NAME'` are taken as they are.",
    ),
    Field("SDPsolverEpsilon", 1e-9, "later", "", "None; a coarse tolerance proves a weaker bound."),
    Field("SDPsolverMaxIter", None, "later", "", "None; few iterations prove a weaker bound."),
    Field("SDPsolverSW", 1, "later", "", "0 builds the SDP without solving it.", _SWITCH),
    Field("SDPsolverOutFile", 0, "later", "", "None: a log."),
    Field("sdpaDataFile", "", "later", "", "None: a file."),
    Field("detailedInfFile", "", "later", "", "None: a file."),
    Field("printFileName", 1, "later", "", "None: a file."),
    Field(
        "multiCliquesFactor",
        1,
        "later",
        "",
        "Larger cliques can prove more. Each constraint is put into one clique that holds it.",
    ),
    Field("scalingSW", 1, "later", "", "None: bounds refer to the problem as given.", _SWITCH),
    Field(
        "boundSW",
        2,
        "later",
        "",
        "None. Bounds enter as (u - x)(x - l) >= 0; the proof uses the box in any case.",
        (0, 1, 2),
    ),
    Field(
        "eqTolerance",
        0,
        "later",
        "",
        "It relaxes equalities, so bounds would stay valid and become weaker.",
    ),
    Field(
        "perturbation",
        0,
        "later",
        "",
        "It changes the objective, so a bound would refer to another problem.",
    ),
    Field("reduceMomentMatSW", 1, "later", "", _MULTIPLIERS, (0, 1, 2)),
    Field("complementaritySW", 0, "later", "", _MULTIPLIERS, _SWITCH),
    Field(
        "SquareOneSW",
        1,
        "later",
        "",
        "None. The reduction is read off the equations themselves, coefficients included.",
        _SWITCH,
    ),
    Field("binarySW", 1, "later", "", "None, as for SquareOneSW.", _SWITCH),
    Field(
        "reduceAMatSW",
        1,
        "later",
        "",
        "None. Fixed variables are always eliminated; with tighten = 1 an infeasible fixed "
        "point is proved infeasible.",
        _SWITCH,
    ),
    Field(
        "errorBdIdx",
        "",
        "later",
        "",
        "It would add proved balls around the minimisers.",
    ),
    Field(
        "fValueUbd",
        "",
        "later",
        "",
        "It belongs to errorBdIdx; a number not attained proves nothing by itself.",
    ),
    Field("reduceEqualitiesSW", 0, "none", "", "None: a developer's switch."),
    Field("elimFrSW", 0, "none", "", "None: a developer's switch."),
    Field("aggressiveSW", 0, "none", "", "None: a developer's switch."),
    Field(
        "symbolicMath",
        1,
        "none",
        "",
        "None: parentheses and right-hand sides in files are always read, and the SDP does "
        "not depend on what is installed.",
        _SWITCH,
    ),
    Field("mex", 1, "none", "", "None: there is one implementation.", _SWITCH),
    Field("SeDuMiSW", 1, "none", "", "None: SparsePOP 2's name of SDPsolverSW.", _SWITCH),
    Field("SeDuMiEpsilon", 1e-9, "none", "", "None: SparsePOP 2's name of SDPsolverEpsilon."),
    Field("SeDuMiOutFile", 0, "none", "", "None: SparsePOP 2's name of SDPsolverOutFile."),
    Field("developmentSW", 0, "none", "", "None: set by the original for itself."),
)


def render_table() -> str:
    """The table of all fields in Markdown, as the documentation shows it."""
    words = {"works": "works", "later": "accepted, no effect yet", "none": "accepted, no meaning"}
    lines = [
        "| field | default | effect | option | what it changes in the proof |",
        "|---|---|---|---|---|",
    ]
    for entry in FIELDS:
        option = f"`{entry.option}`" if entry.option else ""
        default = "" if entry.default is None else f"`{entry.default!r}`"
        note = entry.note_on_proof.replace("|", "\\|")
        lines.append(f"| `{entry.name}` | {default} | {words[entry.effect]} | {option} | {note} |")
    return "\n".join(lines) + "\n"
