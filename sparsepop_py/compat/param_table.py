"""The table of every field of SparsePOP 3.03's ``param``, and what each does here.

It drives the conversion in :mod:`sparsepop_py.compat.param`, and the documentation shows
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
    effect : {"works", "none"}
        It works, or it has no meaning here.
    option : str
        The option of :class:`~sparsepop_py.options.Options` it sets, or ``""``.
    original : str
        What the original does with it.
    ours : str
        What it does here, and what it changes in what is proved.
    test : str
        The test that holds it, as ``file::function``.
    legal : tuple
        The legal values of a switch; empty when other values are legal too.
    plain : bool
        It shapes the plain relaxation and has an effect with ``tighten = 0`` only.
    """

    name: str
    default: Any
    effect: Literal["works", "none"]
    option: str
    original: str
    ours: str
    test: str
    legal: tuple[Any, ...] = ()
    plain: bool = False


_MULTIPLIERS = "It only chooses the multipliers, and any multipliers prove a bound."
_SAME = "The same."
_NAMED = "test_fields_without_effect_are_named"
_INSTALLED = "test_fields_that_follow_the_installation_are_silent"
_WITHOUT = tuple(
    Field(name, value, "none", "", text, "No effect: " + why, "test_param.py::" + test, legal)
    for name, value, text, why, test, legal in (
        *(
            (name, 0, original, "it is no matter of the problem or its relaxation.", _NAMED, ())
            for name, original in (
                ("reduceEqualitiesSW", "A developer's switch."),
                ("elimFrSW", "A developer's switch."),
                ("developmentSW", "Set by the original for itself."),
            )
        ),
        (
            *("symbolicMath", 1),
            "Needed for parentheses in files; with scaling it also shifts variables, so that the "
            "SDP depends on what is installed.",
            "parentheses and right-hand sides in files are always read, and the SDP does not "
            "depend on what is installed.",
            *(_INSTALLED, _SWITCH),
        ),
        (
            *("mex", 1, "C++ conversion, with slightly different SDPs."),
            "there is one implementation. Sizes are those of the C++ path.",
            *(_INSTALLED, _SWITCH),
        ),
    )
)
_OLD_NAMES = tuple(
    Field(
        old,
        default,
        "works",
        option,
        f"SparsePOP 2's name of {new}.",
        _SAME,
        "test_param.py::test_names_of_version_two",
        legal,
    )
    for old, default, option, new, legal in (
        ("SeDuMiSW", 1, "", "SDPsolverSW", _SWITCH),
        ("SeDuMiEpsilon", 1e-9, "accuracy", "SDPsolverEpsilon", ()),
        ("SeDuMiOutFile", 0, "", "SDPsolverOutFile", ()),
    )
)

_FILES = tuple(
    Field(name, default, "works", "", original, ours, "test_sparsepop_files.py::" + test)
    for name, default, original, ours, test in (
        (
            *(
                "SDPsolverOutFile",
                0,
                "The solver's log: off, on the screen, or appended to a file.",
            ),
            *("The same: one line for the last solve.", "test_the_log_of_the_solver"),
        ),
        (
            *("sdpaDataFile", ""),
            "Writes the SDP in SDPA sparse format, and a `.info` file that maps variables.",
            "The same, of the SDP that was solved; `.info` is complete with `tighten = 0`. "
            "Where no SDP was needed, a warning says that there is no file.",
            "test_the_sdpa_file_has_the_value_of_the_sdp",
        ),
        (
            *("detailedInfFile", ""),
            "Appends parameters, the problem before and after scaling, cliques, supports, the SDP.",
            *(_SAME, "test_the_detailed_file"),
        ),
        (
            *("printFileName", 1),
            "A file name: results are appended there. Numbers set the file's print level to 0.",
            *(_SAME, "test_the_printed_file"),
        ),
    )
)

_OWN = tuple(
    Field(name, default, "works", option, "(Not in the original.)", ours, "test_param.py::" + test)
    for name, default, option, ours, test in (
        (
            *("effort", "", "effort"),
            "`'plain'`, `'presolve'` or `'auto'`: the effort itself, in place of `tighten`. "
            "`'auto'` is the adaptive search; give `timeLimit` with it.",
            "test_effort_limits_and_gap_reach_the_options",
        ),
        (
            *("timeLimit", "", "time_limit"),
            "Seconds of wall time, by default no limit. The best proved state is returned.",
            "test_effort_limits_and_gap_reach_the_options",
        ),
        (
            *("localSearch", "", "refine"),
            "0: no local search, so that no point is proved except those that the relaxation gives "
            "away. 1: as long as it takes. `'scipy'`, `'ipopt'` or `'none'`: by name. Without it, "
            "without `POPsolver` and with another effort than `'auto'`, local searches get 1 CPU "
            "second.",
            "test_local_search_by_number_and_name",
        ),
        (
            *("gap", 1e-6, "gap"),
            "The relative gap between proved and attained value that counts as closed.",
            "test_effort_limits_and_gap_reach_the_options",
        ),
    )
)

FIELDS: tuple[Field, ...] = (
    Field(
        "relaxOrder",
        1,
        "works",
        "order",
        "Raised silently to omega_max, the least legal order; a fraction is kept.",
        "The same. With `tighten = 0`, a fraction gives matrices of the whole order below it and "
        "multipliers of equations up to the degree floor(2 (order - ceil(deg / 2))); with "
        "`tighten = 1` the next whole order is used. In exact arithmetic a higher order proves no "
        "less; rounding can take more from its proof. Blocks that do not fit the memory limit are "
        "left out, and a note says so.",
        "test_switches.py::test_a_fraction_is_kept_and_lies_between_orders",
    ),
    Field(
        "sparseSW",
        1,
        "works",
        "sparse",
        "0 dense, 1 correlative sparsity; 2 and 3 are smaller variants of 0 and 1, by the "
        "perturbed sums of squares theorem of Muramatsu, Waki and Tuncel (2016).",
        "0 makes one clique of all variables, which can prove more and costs more. 2 and 3: with "
        "`tighten = 0`, the multiplier of a constraint g has only products of at most "
        "floor(order / deg g - 1/2) of its own terms, as in that paper; such a relaxation proves "
        "no more than that of 0 or 1. With `tighten = 1` they are 0 and 1, with a warning.",
        "test_smaller_relaxations.py::test_multipliers_are_made_of_terms_of_their_constraints",
        (0, 1, 2, 3),
    ),
    Field(
        "multiCliquesFactor",
        1,
        "works",
        "switches.merge",
        "How far cliques that cover a constraint are merged: the union may grow to this factor "
        "times the largest clique. Any string: without limit.",
        "The same; larger unions can prove more.",
        "test_switches.py::test_merged_cliques_grow_the_blocks",
        plain=True,
    ),
    Field(
        "scalingSW",
        1,
        "works",
        "switches.scaled",
        "Boxed variables are divided by their larger bound in size, those with one bound counted "
        "from there, objective and constraints divided by their largest coefficient; nothing is "
        "where a constraint is a cone or a matrix.",
        "0 gives the solver the unscaled program; its multipliers are scaled before they are "
        "certified. Problems with second-order or matrix constraints are scaled too. Bounds always "
        "refer to the problem as given.",
        "test_switches.py::test_the_unscaled_program_has_the_same_value",
        _SWITCH,
        True,
    ),
    Field(
        "boundSW",
        2,
        "works",
        "switches.moment_bounds",
        "Bounds on all lifted monomials (1), or on those that are not redundant (2).",
        "The same. What they add to the proof is interval arithmetic of monomials.",
        "test_switches.py::test_bounds_of_moments",
        (0, 1, 2),
        True,
    ),
    Field(
        "eqTolerance",
        0,
        "works",
        "",
        "Each equation f = 0 becomes f >= 0 and f <= eps after scaling, one-sided in spite of "
        "the guide.",
        "The same, one-sided. The bound is that of the larger set, so it holds for the given "
        "problem and is weaker. `POP.upperBound` is attained in the given problem.",
        "test_sparsepop_problem.py::test_relaxed_equations_keep_the_bound_valid",
    ),
    Field(
        "perturbation",
        0,
        "works",
        "switches.perturbation",
        "Adds eps (2 rand - 1) to every linear coefficient, seed 2008 (the guide says [0, 1]); "
        "the value returned is that of the perturbed objective.",
        "The same seed and range, on the scaled objective. The multipliers found are certified "
        "for the objective as given, which pays for the difference on the box. "
        "`param.perturbation` and `POP.objValue` come back as given.",
        "test_switches.py::test_a_perturbed_objective_proves_the_given_one",
        plain=True,
    ),
    Field(
        "reduceMomentMatSW",
        1,
        "works",
        "switches.consistent",
        "Drops redundant rows of moment matrices; 2 those of constraints too (Waki and Muramatsu "
        "2011).",
        "1: monomials of degree two and more whose squares nothing can match go, until nothing "
        "changes. 2: those of the constraints' multipliers too; as in the original before bounds "
        "of moments are added, so that with `boundSW` the value may be smaller. " + _MULTIPLIERS,
        "test_smaller_relaxations.py::test_eliminated_monomials_change_no_value",
        (0, 1, 2),
        True,
    ),
    Field(
        "aggressiveSW",
        0,
        "works",
        "switches.aggressive",
        "A developer's switch: moment matrices lose variables too, and with them the candidate "
        "solution.",
        "The same, 2 as 1; `POP.xVect` is no vector of moments where a first moment has left. "
        + _MULTIPLIERS,
        "test_smaller_relaxations.py::test_an_aggressive_reduction_may_lose_the_first_moments",
        (0, 1, 2),
        True,
    ),
    Field(
        "complementaritySW",
        0,
        "works",
        "switches.substituted",
        "Lifted monomials that contain x_i x_j of an equation x_i x_j = 0 are set to 0.",
        _SAME + " " + _MULTIPLIERS,
        "test_switches.py::test_substitutions",
        _SWITCH,
        True,
    ),
    Field(
        "SquareOneSW",
        1,
        "works",
        "switches.substituted",
        "Reduction for x^2 = 1; the MATLAB path applies it to any x^2 = c, wrongly.",
        "Substitutes x^2 = c for every c, read off the equation. " + _MULTIPLIERS,
        "test_switches.py::test_squares_with_any_coefficient",
        _SWITCH,
        True,
    ),
    Field(
        "binarySW",
        1,
        "works",
        "switches.substituted",
        "Reduction for x^2 = x; the MATLAB path applies it to any x^2 = c x, wrongly.",
        "Substitutes x^2 = c x for every c; bounds that then say nothing new leave. "
        + _MULTIPLIERS,
        "test_switches.py::test_squares_with_any_coefficient",
        _SWITCH,
        True,
    ),
    Field(
        "reduceAMatSW",
        1,
        "works",
        "switches.independent",
        "Eliminates fixed variables (also x_i = c) and linearly dependent rows of A.",
        "Substitutes x_i = c and drops equations of the program that have become empty. "
        "Variables with equal bounds are always eliminated.",
        "test_switches.py::test_substitutions",
        _SWITCH,
        True,
    ),
    *_WITHOUT,
    Field(
        "SDPsolver",
        "sedumi",
        "works",
        "solver",
        "One of six SDP solvers.",
        "All six are replaced by `'auto'`; `'auto'`, `'clarabel'`, `'clarabel-moment'`, "
        "`'cliquetree'` and `'cvxpy:NAME'` are taken as they are. The bound is recomputed from "
        "whatever multipliers a solver returns.",
        "test_param.py::test_solvers",
    ),
    Field(
        "SDPsolverSW",
        1,
        "works",
        "",
        "0 builds the SDP and reports its size; `SDPobjValue` is empty, pinf and dinf NaN.",
        "The same: `SDPobjValue` is None.",
        "test_sparsepop_problem.py::test_sizes_without_a_solve",
        _SWITCH,
    ),
    Field(
        "SDPsolverEpsilon",
        1e-9,
        "works",
        "accuracy",
        "Tolerance of the solver.",
        "The same, by default 1e-9 whatever the solver's name. A coarse one proves a weaker bound.",
        "test_sparsepop_problem.py::test_a_coarse_tolerance_proves_less",
    ),
    Field(
        "SDPsolverMaxIter",
        None,
        "works",
        "max_iterations",
        "Passed to SeDuMi if present.",
        "Passed to Clarabel and to the clique-tree method. Few iterations prove a weaker bound.",
        "test_sparsepop_problem.py::test_few_iterations_prove_less",
    ),
    *_FILES,
    Field(
        "printLevel",
        (2, 0),
        "works",
        "progress",
        "Screen and file: 0, 1 (without the solution vector), 2. A banner and solver lines "
        "appear even at 0.",
        "0 is silent.",
        "test_sparsepop_face.py::test_report_levels",
    ),
    Field(
        "POPsolver",
        "",
        "works",
        "refine",
        "Local refinement from the SDP's point by a MATLAB solver.",
        "Fills `xVectL` to `scaledErrorL` with a point that provably exists. `'ipopt'` chooses "
        "IPOPT, any other name SciPy. Without it (and without `effort = 'auto'`) local searches "
        "take 1 CPU second at most, for points whose values tighten the proof.",
        "test_sparsepop_face.py::test_refined_point_only_when_asked_for",
    ),
    Field(
        "errorBdIdx",
        "",
        "works",
        "",
        "`'a'`, indices, or a cell of these: balls |x - xCenter|^2 <= zeta that hold every "
        "feasible x with f <= fValueUbd.",
        "The same, proved: zeta comes from a certified maximum of the distance from `xCenter`.",
        "test_sparsepop_problem.py::test_error_bounds_hold_every_minimiser",
    ),
    Field(
        "fValueUbd",
        "",
        "works",
        "",
        "The level of errorBdIdx; an error if that is empty.",
        "The same; by default the attained value.",
        "test_sparsepop_problem.py::test_error_bounds_hold_every_minimiser",
    ),
    Field(
        "tighten",
        1,
        "works",
        "effort",
        "(Not in the original.)",
        '1 is `"presolve"`: finite boxes by propagation and by the attained value, each step part '
        'of the certificate. 0 is `"plain"`: the relaxation of Waki, Kim, Kojima and Muramatsu '
        "of that order under the switches; without finite bounds often nothing can be proved.",
        "test_switches.py::test_values_are_those_of_the_original",
        _SWITCH,
    ),
    *_OWN,
    *_OLD_NAMES,
)


def render_table() -> str:
    """Render the table of all fields in Markdown, as the documentation shows it."""
    lines = [
        "| field | default | the original | here | option | test |",
        "|---|---|---|---|---|---|",
    ]
    for entry in FIELDS:
        option = f"`{entry.option}`" if entry.option else ""
        default = "" if entry.default is None else f"`{entry.default!r}`"
        original, ours = (text.replace("|", "\\|") for text in (entry.original, entry.ours))
        if entry.plain:
            ours = "(`tighten = 0`) " + ours
        cells = (f"`{entry.name}`", default, original, ours, option, f"`{entry.test}`")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
