"""The param struct: every container, every field, illegal values, and the table in the docs."""

from __future__ import annotations

import copy
import io
import pathlib
import pickle
import re
import warnings
from dataclasses import make_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sps

from sparsepop_py.compat.param import Parameters, read_parameters
from sparsepop_py.compat.param_table import FIELDS, render_table
from sparsepop_py.errors import ParameterWarning, ProblemError
from sparsepop_py.options import Options
from sparsepop_py.relaxation.sparsepop.relaxation import Switches

DOCS = pathlib.Path(__file__).parents[2] / "docs" / "parameters.md"
# Every field that SparsePOP 3.03's defaultParameter knows or echoes, and SparsePOP 2's names.
ORIGINAL = """
relaxOrder sparseSW multiCliquesFactor scalingSW boundSW eqTolerance perturbation
reduceMomentMatSW complementaritySW SquareOneSW binarySW reduceAMatSW reduceEqualitiesSW
elimFrSW aggressiveSW SDPsolver SDPsolverSW SDPsolverEpsilon SDPsolverMaxIter SDPsolverOutFile
sdpaDataFile detailedInfFile printFileName printLevel symbolicMath POPsolver mex errorBdIdx
fValueUbd SeDuMiEpsilon developmentSW SeDuMiSW SeDuMiOutFile
""".split()


def loaded(param: dict[str, Any], **how: Any) -> Any:
    file = io.BytesIO()
    scipy.io.savemat(file, {"param": param})
    file.seek(0)
    return scipy.io.loadmat(file, **how)["param"]


# ---- what works -------------------------------------------------------------------------


@pytest.mark.parametrize("nothing", [None, {}, [], np.zeros((0, 0)), SimpleNamespace()])
def test_defaults(nothing: Any) -> None:
    parameters = read_parameters(nothing)
    assert parameters == Parameters(
        options=Options(order=1, chordal="min-degree", search_limit=1.0, progress=True)
    )
    assert parameters.options.effort == "presolve"
    assert parameters.printLevel == (2, 0)


GIVEN = {"relaxOrder": 3, "sparseSW": 0, "POPsolver": "active-set", "printLevel": 0, "tighten": 0}


@pytest.mark.parametrize(
    "param",
    [
        GIVEN,
        SimpleNamespace(**GIVEN),
        make_dataclass("Param", [(name, Any) for name in GIVEN])(**GIVEN),
        loaded(GIVEN),
        loaded(GIVEN, squeeze_me=True),
        loaded(GIVEN, struct_as_record=False),
        loaded(GIVEN, struct_as_record=False, squeeze_me=True),
        loaded(GIVEN)[0, 0],
    ],
    ids=["dict", "namespace", "dataclass", "mat", "squeezed", "object", "mat_struct", "void"],
)
def test_containers(param: Any) -> None:
    parameters = read_parameters(param)
    assert parameters.POPsolver == "active-set"
    assert parameters.printLevel == (0, 0)
    switches = Switches(order=3)
    expected = Options(
        order=3, sparse=False, chordal="min-degree", effort="plain", switches=switches
    )
    assert parameters.options == expected


@pytest.mark.parametrize(
    ("given", "order"), [(0, 1), (1, 1), (2.0, 2), (True, 1), (np.float64(4), 4), ([[3]], None)]
)
def test_order(given: Any, order: int | None) -> None:
    value = np.array(given) if isinstance(given, list) else given
    assert read_parameters({"relaxOrder": value}).options.order == (order or 3)


@pytest.mark.parametrize("wrap", [lambda v: [v], lambda v: ([v],), lambda v: np.array([[v]])])
def test_lists_of_one_are_scalars_as_in_matlab(wrap: Any) -> None:
    given = {name: wrap(value) for name, value in GIVEN.items()}
    given["errorBdIdx"] = wrap(2)
    assert read_parameters(given).options == read_parameters(GIVEN).options
    assert read_parameters(given).errorBdIdx == 2


@pytest.mark.parametrize(("tighten", "order"), [(1, 3), (0, 2)])
def test_a_fraction_is_kept(tighten: int, order: int) -> None:
    parameters = read_parameters({"relaxOrder": 2.5, "tighten": tighten})
    assert (parameters.relaxOrder, parameters.options.order) == (2.5, order)
    switches = parameters.options.switches
    assert switches is None if tighten else switches is not None and switches.order == 2.5


@pytest.mark.parametrize(("given", "sparse"), [(2, False), (3, True)])
def test_perturbed_variants(given: int, sparse: bool) -> None:
    options = read_parameters({"sparseSW": given, "tighten": 0}).options
    assert options.sparse is sparse
    assert options.switches is not None and options.switches.narrow
    with pytest.warns(ParameterWarning, match=f"sparseSW = {given} is treated as {given - 2} with"):
        parameters = read_parameters({"sparseSW": given})
    assert parameters.options.sparse is sparse
    assert parameters.sparseSW == given


def test_a_negative_perturbation_is_a_size_and_comes_back_as_given() -> None:
    parameters = read_parameters({"perturbation": -1e-3, "tighten": 0})
    assert parameters.perturbation == -1e-3
    switches = parameters.options.switches
    assert switches is not None and switches.perturbation == 1e-3


@pytest.mark.parametrize(
    ("given", "level"), [(0, (0, 0)), (1, (1, 0)), ([2, 2], (2, 2)), (np.array([[1, 0]]), (1, 0))]
)
def test_print_level(given: Any, level: tuple[int, int]) -> None:
    parameters = read_parameters({"printLevel": given})
    assert parameters.printLevel == level
    assert parameters.options.progress == (level[0] > 0)


def test_solvers() -> None:
    assert read_parameters({"SDPsolver": "sedumi"}).options.solver == "auto"
    assert read_parameters({"SDPsolver": "cvxpy:SCS"}).options.solver == "cvxpy:SCS"
    with pytest.warns(ParameterWarning, match="'sdpt3' is replaced by 'auto'"):
        parameters = read_parameters({"SDPsolver": "sdpt3"})
    assert (parameters.SDPsolver, parameters.options.solver) == ("sdpt3", "auto")


def test_local_solvers() -> None:
    assert read_parameters({"POPsolver": np.zeros((0, 0))}).POPsolver == ""
    assert read_parameters({"POPsolver": "ipopt"}).options.refine == "ipopt"
    with pytest.warns(ParameterWarning, match="POPsolver = 'fmincon' is unknown and treated as"):
        assert read_parameters({"POPsolver": "fmincon"}).options.refine == "scipy"


# ---- what does not ----------------------------------------------------------------------


@pytest.mark.parametrize("entry", FIELDS, ids=lambda entry: entry.name)
def test_the_default_of_the_original_is_silent(entry: Any) -> None:
    if entry.default is not None:
        read_parameters({entry.name: entry.default})


OWN = ("tighten", "effort", "timeLimit", "localSearch", "gap")


def test_every_field_of_the_original_is_known() -> None:
    assert sorted(entry.name for entry in FIELDS) == sorted([*ORIGINAL, *OWN])


NOTHING = ["reduceEqualitiesSW", "elimFrSW", "developmentSW"]


@pytest.mark.parametrize("name", NOTHING)
def test_fields_without_effect_are_named(name: str) -> None:
    with pytest.warns(ParameterWarning, match=rf"param\.{name} = 1 has no effect here") as seen:
        parameters = read_parameters({name: 1})
    assert len(seen) == 1
    assert seen[0].filename == __file__
    assert getattr(parameters, name) == 1


PLAIN: dict[str, Any] = {
    "multiCliquesFactor": 2,
    "scalingSW": 0,
    "boundSW": 0,
    "perturbation": 1e-4,
    "reduceMomentMatSW": 0,
    "aggressiveSW": 1,
    "complementaritySW": 1,
    "SquareOneSW": 0,
    "binarySW": 0,
    "reduceAMatSW": 0,
}


@pytest.mark.parametrize("name", PLAIN)
def test_switches_of_the_plain_relaxation(name: str) -> None:
    """They change the options with tighten = 0, and say that they do not with tighten = 1."""
    plain = read_parameters({"tighten": 0})
    changed = read_parameters({"tighten": 0, name: PLAIN[name]})
    assert changed.options != plain.options
    assert getattr(changed, name) == PLAIN[name]
    with pytest.warns(ParameterWarning, match=rf"{name} = .* has an effect with tighten = 0 only"):
        assert read_parameters({name: PLAIN[name]}).options == read_parameters({}).options


def test_every_field_of_the_plain_relaxation_is_tried() -> None:
    assert {entry.name for entry in FIELDS if entry.plain} == set(PLAIN)


def test_any_string_lets_cliques_grow_without_limit() -> None:
    parameters = read_parameters({"tighten": 0, "multiCliquesFactor": "objPoly.dimVar"})
    assert parameters.options.switches is not None
    assert parameters.options.switches.merge == float("inf")


def test_names_of_version_two() -> None:
    old = {"SeDuMiSW": 0, "SeDuMiEpsilon": 1e-5, "SeDuMiOutFile": "log.txt"}
    parameters = read_parameters(old)
    assert (parameters.SDPsolverSW, parameters.SDPsolverOutFile) == (0, "log.txt")
    assert parameters.options.accuracy == parameters.SDPsolverEpsilon == 1e-5
    new = read_parameters({"SDPsolverSW": 0, "SDPsolverEpsilon": 1e-5})
    assert (new.SeDuMiSW, new.SeDuMiEpsilon, new.SeDuMiOutFile) == (0, 1e-5, 0)  # as an echo
    both = read_parameters({"SeDuMiEpsilon": 1e-5, "SDPsolverEpsilon": 1e-6})
    assert both.options.accuracy == 1e-6


def test_solver_settings() -> None:
    parameters = read_parameters({"SDPsolverMaxIter": 7.0, "SDPsolverEpsilon": 1e-4})
    assert (parameters.options.max_iterations, parameters.options.accuracy) == (7, 1e-4)


def test_a_file_to_print_to_turns_its_level_on() -> None:
    assert read_parameters({"printFileName": "out.txt"}).printLevel == (2, 2)
    assert read_parameters({"printFileName": "out.txt", "printLevel": 1}).printLevel == (1, 0)


def test_cells_of_indices() -> None:
    cell = np.empty((1, 2), object)
    cell[0, :] = [np.array([[1, 2]]), np.array([["a"]])]
    assert read_parameters({"errorBdIdx": cell}).errorBdIdx == [[1, 2], "a"]


@pytest.mark.parametrize("name", ["mex", "symbolicMath"])
@pytest.mark.parametrize("value", [0, 1])
def test_fields_that_follow_the_installation_are_silent(name: str, value: int) -> None:
    assert getattr(read_parameters({name: value}), name) == value


@pytest.mark.parametrize(
    ("name", "near"), [("relaxorder", "relaxOrder"), ("sparse", "sparseSW"), ("qqq", "")]
)
def test_unknown_fields(name: str, near: str) -> None:
    expected = rf"param\.{name}: unknown field" + (f", did you mean {near}\\?" if near else "$")
    with pytest.warns(ParameterWarning, match=expected):
        read_parameters({name: 1})
    with pytest.raises(ProblemError, match=expected):
        read_parameters({name: 1}, strict=True)


# ---- what is wrong ----------------------------------------------------------------------

ILLEGAL: list[tuple[Any, str]] = [
    ({"relaxOrder": -1}, r"param.relaxOrder: found -1, expected a number >= 0"),
    ({"relaxOrder": "two"}, r"param.relaxOrder: found 'two', expected a number >= 0"),
    ({"relaxOrder": float("nan")}, r"param.relaxOrder: found nan, expected a number >= 0"),
    ({"relaxOrder": float("inf")}, r"param.relaxOrder: found inf, expected a number >= 0"),
    ({"relaxOrder": [1, 2]}, r"param.relaxOrder: found \[1, 2\], expected a number >= 0"),
    ({"sparseSW": 7}, r"param.sparseSW: found 7, expected one of 0, 1, 2, 3"),
    ({"sparseSW": "on"}, r"param.sparseSW: found 'on', expected one of 0, 1, 2, 3"),
    ({"sparseSW": 0.5}, r"param.sparseSW: found 0.5, expected one of 0, 1, 2, 3"),
    ({"printLevel": "a"}, r"param.printLevel: found 'a', expected 0, 1 or 2, or two of these"),
    ({"printLevel": [1, 2, 2]}, r"param.printLevel: found \[1, 2, 2\], expected 0, 1 or 2"),
    ({"printLevel": [3, 0]}, r"param.printLevel: found \[3, 0\], expected 0, 1 or 2"),
    ({"tighten": 2}, r"param.tighten: found 2, expected one of 0, 1"),
    ({"POPsolver": 1}, r"param.POPsolver: found 1, expected the name of a local solver"),
    ({"SDPsolver": "mosek"}, r"param.SDPsolver: found 'mosek', expected one of 'sedumi', 'sdpa'"),
    ({"SDPsolver": 3}, r"param.SDPsolver: found 3, expected one of 'sedumi'"),
    ({"scalingSW": 2}, r"param.scalingSW: found 2, expected one of 0, 1"),
    ({"boundSW": -1}, r"param.boundSW: found -1, expected one of 0, 1, 2"),
    ({"mex": "yes"}, r"param.mex: found 'yes', expected one of 0, 1"),
    ({"eqTolerance": 1e-11}, r"param.eqTolerance: found 1e-11, expected 0 or a number of at"),
    ({"eqTolerance": -1e-3}, r"param.eqTolerance: found -0.001, expected 0 or a number of at"),
    ({"perturbation": 1e-11}, r"param.perturbation: found 1e-11, expected 0 or a number of at"),
    ({"multiCliquesFactor": -1}, r"param.multiCliquesFactor: found -1, expected a number from 0"),
    ({"SDPsolverEpsilon": 0}, r"param.SDPsolverEpsilon: found 0, expected a number > 0"),
    ({"SDPsolverMaxIter": 1.5}, r"param.SDPsolverMaxIter: found 1.5, expected a positive integer"),
    ({"SDPsolverOutFile": 2}, r"param.SDPsolverOutFile: found 2, expected 0, 1 or the name of a"),
    ({"sdpaDataFile": "a.txt"}, r"param.sdpaDataFile: found 'a.txt', expected .* ends in .dat-s"),
    ({"detailedInfFile": 1}, r"param.detailedInfFile: found 1, expected the name of a file"),
    ({"printFileName": 3}, r"param.printFileName: found 3, expected 0, 1 or the name of a file"),
    ({"errorBdIdx": "b"}, r"param.errorBdIdx: found 'b', expected 'a', indices of variables"),
    ({"errorBdIdx": [0, 1]}, r"param.errorBdIdx: found \[0, 1\], expected 'a', indices"),
    ({"fValueUbd": 1.0}, r"param.fValueUbd: found 1.0, expected nothing, since errorBdIdx is em"),
    ({"fValueUbd": "x", "errorBdIdx": "a"}, r"param.fValueUbd: found 'x', expected a number"),
    ({1: 2}, r"param: found the key 1, expected names of fields"),
    (3, r"param: found int, expected a dict or a struct of parameters"),
    ("relaxOrder", r"param: found str, expected a dict or a struct of parameters"),
    ([{"relaxOrder": 2}], r"param: found list, expected a dict or a struct of parameters"),
    (Options, r"param: found type, expected a dict or a struct of parameters"),
]


@pytest.mark.parametrize("name", ["printFileName", "SDPsolver", "SDPsolverOutFile", "relaxOrder"])
def test_empty_text_is_no_value_as_from_matlab(name: str) -> None:
    """A struct of a MAT file holds '' as an empty array, which has always been no value."""
    for empty in ("", np.zeros(0, dtype="<U1"), []):
        assert read_parameters({name: empty}) == read_parameters()


@pytest.mark.parametrize(("param", "message"), ILLEGAL, ids=lambda value: str(value)[:40])
def test_illegal(param: Any, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        read_parameters(param)


def test_strict_refuses_unknown_local_solvers() -> None:
    with pytest.raises(ProblemError, match="param.POPsolver: found 'fmincon', expected one of"):
        read_parameters({"POPsolver": "fmincon"}, strict=True)


# ---- the object -------------------------------------------------------------------------


def test_what_was_read_can_be_read_again() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        more = {"eqTolerance": 1e-3, "boundSW": 1, "relaxOrder": 2.5, "mine": "x"}
        parameters = read_parameters({**GIVEN, **more})
        assert read_parameters(parameters) == parameters
        assert copy.deepcopy(parameters) == pickle.loads(pickle.dumps(parameters)) == parameters


def test_fields_that_were_not_given_hold_the_original_default() -> None:
    parameters = read_parameters({})
    assert (parameters.boundSW, parameters.multiCliquesFactor) == (2, 1)
    with pytest.raises(AttributeError, match="param has no field 'nothing'"):
        _ = parameters.nothing


def test_the_input_is_not_modified() -> None:
    param = {"relaxOrder": np.array([[2]]), "printLevel": [2, 2], "POPsolver": "lsqnonlin"}
    before = copy.deepcopy(param)
    read_parameters(param)
    assert param == before


def test_every_test_that_is_named_exists() -> None:
    """In the table of fields and in the list of traps below it."""
    here = {path.name: path for path in pathlib.Path(__file__).parents[1].rglob("test_*.py")}
    named = set(re.findall(r"`(test_\w+\.py)::(test_\w+)`", DOCS.read_text()))
    assert {f"{file}::{name}" for file, name in named} >= {entry.test for entry in FIELDS}
    absent = [
        f"{file}::{name}"
        for file, name in sorted(named)
        if f"def {name}(" not in here[file].read_text()
    ]
    assert absent == []


def test_the_documentation_shows_the_table() -> None:
    assert render_table() in DOCS.read_text()


# ---- fields of our own ------------------------------------------------------------------


def test_effort_limits_and_gap_reach_the_options() -> None:
    options = read_parameters({"effort": "auto", "timeLimit": 30, "gap": 1e-3}).options
    assert (options.effort, options.time_limit, options.gap) == ("auto", 30.0, 1e-3)
    assert options.switches is None
    unlimited = read_parameters({"timeLimit": np.inf, "effort": ""}).options
    assert (unlimited.effort, unlimited.time_limit, unlimited.gap) == ("presolve", None, 1e-6)
    plain = read_parameters({"effort": "plain", "relaxOrder": 3})
    assert (plain.tighten, plain.options.effort) == (0, "plain")
    assert plain.options.switches is not None and plain.options.switches.order == 3


def test_effort_overrules_tighten_and_says_so() -> None:
    with pytest.warns(ParameterWarning, match="tighten = 0 is overruled by param.effort = 'auto'"):
        parameters = read_parameters({"effort": "auto", "tighten": 0})
    assert (parameters.tighten, parameters.options.effort) == (1, "auto")
    again = read_parameters(parameters)
    assert again.options == parameters.options


@pytest.mark.parametrize(
    ("given", "refine"),
    [(0, "none"), (1, "scipy"), (1.0, "scipy"), ("none", "none"), ("ipopt", "ipopt")],
)
def test_local_search_by_number_and_name(given: Any, refine: str) -> None:
    assert read_parameters({"localSearch": given}).options.refine == refine


@pytest.mark.parametrize(
    ("given", "seconds"),
    [
        ({}, 1.0),
        ({"localSearch": ""}, 1.0),
        ({"localSearch": 1}, None),
        ({"POPsolver": "active-set"}, None),
        ({"effort": "auto"}, None),
        ({"effort": "plain"}, 1.0),
    ],
)
def test_a_search_that_nobody_asked_for_is_short(
    given: dict[str, Any], seconds: float | None
) -> None:
    assert read_parameters(given).options.search_limit == seconds


def test_a_local_solver_does_not_switch_the_search_on() -> None:
    given = {"localSearch": 0, "POPsolver": "ipopt"}
    assert read_parameters(given).options.refine == "none"
    assert read_parameters({"POPsolver": "ipopt"}).options.refine == "ipopt"


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("effort", "most", "one of 'plain', 'presolve', 'auto'"),
        ("effort", 2, "one of 'plain', 'presolve', 'auto'"),
        ("timeLimit", 0, "seconds > 0"),
        ("timeLimit", "long", "seconds > 0"),
        ("gap", -1, "a number >= 0"),
        ("localSearch", 2, "one of 0, 1, scipy, ipopt, none"),
        ("localSearch", [0, 1], "one of 0, 1, scipy, ipopt, none"),
    ],
)
def test_wrong_values_of_own_fields(name: str, value: Any, expected: str) -> None:
    with pytest.raises(ProblemError, match=rf"param.{name}: found .*, expected {expected}"):
        read_parameters({name: value})


@pytest.mark.parametrize(
    "value", [[[[1]], [2]], [["a"], [1]], [[1, [2]], [1]], [0], [[1.5], [2]], 1j]
)
def test_sets_of_variables_hold_indices_alone(value: Any) -> None:
    with pytest.raises(ProblemError, match=r"param.errorBdIdx: found .*, expected 'a', indices"):
        read_parameters({"errorBdIdx": value})


def test_messages_stay_short() -> None:
    """Python does not print integers of more than 4300 digits."""
    for name, value in (("relaxOrder", 10**5000), ("tighten", 10**5000), ("gap", "x" * 5000)):
        with pytest.raises(ProblemError, match=rf"^param.{name}: found .{{,70}}, expected"):
            read_parameters({name: value})
    with pytest.warns(ParameterWarning, match="param.elimFrSW = an integer of thousands of"):
        read_parameters({"elimFrSW": 10**5000})


def test_sparse_values_are_written_out_where_they_fit() -> None:
    assert read_parameters({"relaxOrder": sps.csr_array([[3.0]])}).relaxOrder == 3
    with pytest.raises(ProblemError, match="param.relaxOrder: found a sparse matrix of 1000000 x"):
        read_parameters({"relaxOrder": sps.csr_array((10**6, 10**6))})
