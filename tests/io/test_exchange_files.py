"""SDPA, JSON and MAT files: what is written reads back the same, and wrong files are named."""

from __future__ import annotations

import copy
import json
import pathlib
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sps
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from random_cases import SEEDS, random_case

import sparsepop_py as sp
from sparsepop_py.conic.program import Cones
from sparsepop_py.errors import FormatError, ProblemError
from sparsepop_py.io.json_files import certificates as json_certificates
from sparsepop_py.io.json_files import values as json_
from sparsepop_py.verified.box.left_inverse import LeftInverse
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.sos_identity import Identity, Multipliers, Priced
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Known,
    Propagation,
    Step,
    Sublevel,
    Tightening,
)

few = settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def product() -> sp.Problem:
    x, y = sp.variables(2, ["a", "b"])
    return sp.Problem(x * y, [x**2 + y**2 <= 1, x - y == 0.1], -1, [1, np.inf], sense="max")


def residuals() -> sp.Problem:
    x, y = sp.variables(2)
    parts = [x - 1 / 3, y - x**2, 0.1 * x * y]
    objective = parts[0] * parts[0] + parts[1] * parts[1] + parts[2] * parts[2]
    return sp.Problem(objective, squares=parts)


# ---- JSON ------------------------------------------------------------------------------------


def same(a: sp.Problem, b: sp.Problem) -> None:
    assert a.fingerprint == b.fingerprint
    assert (a.names, a.sense) == (b.names, b.sense)
    assert [w for w, _ in a.squares] == [w for w, _ in b.squares]
    for (_, p), (_, q) in zip(a.squares, b.squares, strict=True):
        assert np.array_equal(p.words, q.words) and np.array_equal(p.coefficients, q.coefficients)


@pytest.mark.parametrize("make", [product, residuals])
def test_problems_as_json(make: Any, tmp_path: pathlib.Path) -> None:
    problem = make()
    same(sp.from_json(sp.to_json(problem)), problem)
    sp.write_json(problem, tmp_path / "p.json")
    same(sp.read_json(tmp_path / "p.json"), problem)


@given(SEEDS, st.floats(allow_nan=False, allow_infinity=False))
@few
def test_random_problems_as_json(seed: int, value: float) -> None:
    problem = random_case(seed).problem
    odd = sp.Problem(problem.objective + value, problem.constraints, problem.lower, np.inf)
    same(sp.from_json(sp.to_json(odd)), odd)


@given(SEEDS)
@example(381269298)  # its point's value changes in the last digit when it is proved again
@example(308)  # and once more the next time
@settings(few, max_examples=8)
def test_results_and_certificates_as_json(seed: int) -> None:
    """Whatever a certificate proves, it proves when it is read back."""
    problem = random_case(seed).problem
    effort = ("plain", "presolve", "auto")[seed % 3]
    switches = sp.Switches(order=2) if effort == "plain" else None
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=2, switches=switches))
    back = sp.from_json(sp.to_json(result))
    assert (back.status, back.lower_bound) == (result.status, result.lower_bound)
    assert back.upper_bound >= result.upper_bound
    assert back.upper_bound == pytest.approx(result.upper_bound, rel=1e-12, abs=1e-12)
    assert back.options == result.options
    assert back.notes == result.notes and len(back.history) == len(result.history)
    same(back.problem, problem)
    if result.certificate is not None:
        alone = sp.from_json(sp.to_json(result.certificate))
        for certificate in (alone, back.certificate):
            assert certificate.verify(problem) == result.certificate.verify(problem)
            assert certificate.bound == result.certificate.bound
    if result.attained is not None:
        again = back.attained.recheck(problem).value  # of a point that was proved again when read
        assert again == pytest.approx(result.attained.recheck(problem).value, rel=1e-12, abs=1e-12)


def test_quoted_certificates_and_trees_as_json() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x * y >= 1, x**2 + y**3 <= 3, y - x**2 <= 0.5], 0, 4)
    results = sp.solve_each(problem, [x, -x, y, -y], sp.Options(effort="auto", time_limit=20))
    certificates = [result.certificate for result in results]
    deep = certificates[0]
    quoted = replace(
        deep, root=replace(deep.root, box=BoxProof((Known(((1, 1, certificates[2]),) * 2),)))
    )
    about_each = [*(result.problem for result in results), results[0].problem]
    for certificate, about in zip([*certificates, quoted], about_each, strict=True):
        back = sp.from_json(sp.to_json(certificate))
        assert back.verify(about) == certificate.verify(about)
        assert (back.leaves, back.numbers) == (certificate.leaves, certificate.numbers)
        assert sp.to_json(back) == sp.to_json(certificate)


def test_a_changed_certificate_is_refused() -> None:
    problem = product()
    text = sp.to_json(sp.solve(problem).certificate)
    found = json.loads(text)
    found["certificate"][0]["bound"] += 0.5
    assert not sp.from_json(json.dumps(found)).verify(problem).ok


def test_every_field_of_a_certificate_is_written() -> None:
    """A field that is added to one of these classes must be added to the codec."""
    codecs = {
        Scaling: json_certificates.SCALING,
        Multipliers: json_certificates.MULTIPLIERS,
        Priced: json_certificates.PRICED,
        Identity: json_certificates.IDENTITY,
        LinearDual: json_certificates.LINEAR,
    }
    x, y = sp.variables(2)
    boxed = sp.Problem(x * y, [x + y >= 0.5], 0, 1)
    result = sp.solve(boxed, sp.Options(effort="plain", switches=sp.Switches()))
    identity = result.certificate.identity
    linear = LinearDual(identity.scaling, *(np.zeros(0, int),) * 4, np.zeros((0, 2), int))
    values = [identity.scaling, identity.multipliers[0], identity.priced, identity, linear]
    for value in values:
        written = codecs[type(value)].write(value)
        assert set(written) == {f.name for f in fields(value)}
    steps = {*get_args(Step)} - {Known}
    for step, codec in (
        (LeftInverse, json_certificates.INVERSE),
        (Sublevel, json_certificates.SUBLEVEL),
        (Tightening, json_certificates.TIGHTENING),
        (Propagation, json_certificates.PROPAGATION),
    ):
        steps.remove(step)
        blank = SimpleNamespace(**{f.name: np.zeros(0) for f in fields(step)})
        blank.sweeps, blank.uses_cutoff, blank.cutoff = 1, True, 0.0
        blank.identity, blank.argument = identity, linear
        assert set(codec.write(blank)) == {f.name for f in fields(step)}
    assert steps == set()
    unwritten = {"relaxation", "solution", "moments"}
    written = set(json_.RESULT.write(result))
    assert written == {f.name for f in fields(result)} - unwritten
    options = set(json.loads(sp.to_json(result))["result"]["options"])
    assert options == {f.name for f in fields(sp.Options)} - {"executor"}


def edited(change: Any) -> str:
    found = json.loads(sp.to_json(product()))
    change(found)
    return json.dumps(found)


WRONG: list[tuple[str, str]] = [
    ("", r"JSON: found no JSON \(Expecting value at line 1, column 1\), expected JSON text"),
    ("[" * 100000, "JSON: found objects or lists nested too deeply"),
    ("[]", r"JSON: found \[\], expected an object"),
    ("{}", r"JSON.format: found nothing"),
    (edited(lambda d: d.update(format="x")), r"JSON.format: found 'x', expected 'sparsepop-py'"),
    (
        edited(lambda d: d.update(version=1)),
        r"JSON.version: found 1, expected one of the integers 3, 4, 5, 6, 7",
    ),
    (edited(lambda d: d.update({"is": "cat"})), r"JSON.is: found 'cat', expected one of problem"),
    (edited(lambda d: d["problem"].pop("lower")), r"problem.lower: found nothing"),
    (
        edited(lambda d: d["problem"]["objective"]["words"]["data"].append(1)),
        r"problem.objective.words.data: found '3 numbers', expected 2",
    ),
    (
        edited(lambda d: d["problem"]["objective"]["words"].update(data=[1, 7])),
        r"found a variable outside 1..2",
    ),
    (
        edited(lambda d: d["problem"]["objective"]["words"].update(data=[1, 2**40])),
        r"expected 32-bit integers",
    ),
    (
        edited(lambda d: d["problem"]["objective"]["coefficients"].update(data=["x"])),
        r"coefficients.data: found 'x', expected a number",
    ),
    (
        edited(lambda d: d["problem"]["objective"]["coefficients"].update(data=["nan"])),
        r"coefficients: found nan, expected finite",
    ),
    (
        edited(lambda d: d["problem"]["constraints"][0].update(kind="MAYBE")),
        r"constraints\[0\].kind: found 'MAYBE', expected one of NONNEGATIVE, ZERO",
    ),
    (edited(lambda d: d["problem"]["lower"].update(type="f2")), r"lower.type: found 'f2'"),
    (  # the short float next to 0.1 is another bound
        edited(lambda d: d["problem"]["lower"].update(type="f4", data=[-1.0, 0.1])),
        r"lower.data: found \[-1.0, 0.1\], expected numbers that 32 bits hold",
    ),
    (edited(lambda d: d["problem"]["lower"].update(shape=[-1])), r"lower.shape: found \[-1\]"),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_malformed_json(text: str, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        sp.from_json(text)


def test_malformed_certificates() -> None:
    good = json.loads(sp.to_json(sp.solve(product()).certificate))

    def broken(change: Any) -> str:
        found = copy.deepcopy(good)
        change(found["certificate"][0])
        return json.dumps(found)

    cases = [
        (lambda c: c.update(parts=[]), r"parts: found \[\], expected a list of parts"),
        (lambda c: c["parts"][0].update(children=[0, 0]), r"expected numbers of later parts"),
        (lambda c: c["parts"][0].update(children=[5, 6]), r"expected numbers of later parts"),
        (lambda c: c["parts"][0].update(argument={"is": "Magic"}), r"is: found 'Magic'"),
        (lambda c: c["parts"][0].update(empty=1), r"empty: found 1, expected true or false"),
        (lambda c: c["parts"][0].update(branch=[1]), r"branch: found \[1\], expected two numbers"),
        (
            lambda c: c["parts"][0].update(steps=[{"is": "Known", "bounds": [[0, 1, 3]]}]),
            r"expected variable, side and the number of a certificate",
        ),
    ]
    for change, message in cases:
        with pytest.raises(ProblemError, match=message):
            sp.from_json(broken(change))


def test_files_and_values_that_are_no_json(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FormatError, match=r"nowhere.json: no such file"):
        sp.read_json(tmp_path / "nowhere.json")
    with pytest.raises(ProblemError, match=r"to_json: found int, expected a Problem, Certif"):
        sp.to_json(7)


def test_values_that_write_themselves_are_sent_to_their_own_method() -> None:
    """Identifications of setid have ``to_json``; its name alone counts here."""
    identification: Any = SimpleNamespace(to_json=str)
    with pytest.raises(ProblemError, match=r"or Result \(this object has a method to_json of its"):
        sp.to_json(identification)


# ---- SDPA ------------------------------------------------------------------------------------


@given(SEEDS)
@few
def test_programs_as_sdpa(tmp_path: pathlib.Path, seed: int) -> None:
    case = random_case(seed)
    relaxation = sp.relax(case.problem, 2)
    program = sp.assemble(relaxation, case.problem.objective)
    path = tmp_path / "program.dat-s"
    sp.write_sdpa(program, path, "a title of several words")
    back = sp.read_sdpa(path)
    assert back.cones == program.cones
    assert back.offset == program.offset
    assert np.array_equal(back.q, program.q)
    assert np.abs(back.b - program.b).max() == 0  # constants stand on diagonals or are 0 here
    assert abs(back.A - program.A).max() <= 4e-16 * max(1.0, abs(program.A).max())


EXAMPLE = """"Example 1: mDim = 3, nBLOCK = 1, {2}"
   3  =  mDIM
   1  =  nBLOCK
   2  =  bLOCKsTRUCT
{48, -8, 20}
0 1 1 1 -11
0 1 2 2 23
1 1 1 1 10
1 1 1 2 4
2 1 2 2 -8
3 1 1 2 -8
3 1 2 2 -2
"""


def test_the_example_of_the_manual(tmp_path: pathlib.Path) -> None:
    """SDPA User's Manual, example 1: the optimal value is -41.9."""
    path = tmp_path / "example1.dat-s"
    path.write_text(EXAMPLE)
    program = sp.read_sdpa(path)
    assert program.cones == Cones(0, 0, (2,))
    solution = sp.solve_conic(program)
    assert solution.primal == pytest.approx(-41.9, abs=1e-4)


def test_diagonal_blocks(tmp_path: pathlib.Path) -> None:
    """min y1 + 2 y2 with y1 + y2 >= 1, y >= 0, entries below the diagonal and blocks of size 1."""
    text = "2\n3\n(-2, 1, 2)\n1.0D0 2\n1 1 1 1 1\n2 1 2 2 1\n0 2 1 1 1\n1 2 1 1 1\n2 2 1 1 1\n"
    path = tmp_path / "diagonal.dat-s"
    path.write_text(text + "1 3 2 1 1.0\n0 3 1 1 -1.0\n0 3 2 2 -1.0\n")
    program = sp.read_sdpa(path)
    assert program.cones == Cones(0, 3, (2,))
    assert sp.solve_conic(program).primal == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"the file ends where mDIM was expected"),
        ("x\n", r":1: expected mDIM, an integer of at least 0"),
        ("1\n0\n", r":2: expected nBLOCK, an integer of at least 1"),
        ("1\n1\n-1\n1e400\n", r":4: expected the objective, finite numbers"),
        ("2\n1\n", r"ends where bLOCKsTRUCT was expected"),
        ("1\n1\n0\n1\n", r"found a block of size 0"),
        ("1\n1\n1.5\n1\n", r"expected bLOCKsTRUCT, integers"),
        ("1\n1\n99999999999999999999\n1\n", r":3: found blocks of more than 100000000 entries"),
        ("1\n2\n-1 20000\n1\n", r":3: found blocks of more than 100000000 entries"),
        ("1\n1\n2\n1\n1 1 1e400 1 1\n", r"found the entry 1 1 inf 1 1"),
        ("2\n1\n2\n1.0 x\n1 1 1 1 1\n", r":4: found 'x', expected the objective, 2 numbers"),
        ("2\n1\n2\n1.0 nan\n1 1 1 1 1\n", r":4: found 'nan', expected the objective"),
        ("1\n1\n2\n1\n1 1 1 1\n", r":5: found 4 numbers, expected matrix, block, row"),
        ("1\n1\n2\n1\n1 1 1 3 1.0\n", r"found the entry 1 1 1 3 1, expected one of 1 matrices"),
        ("1\n1\n2\n1\n1 2 1 1 1.0\n", r"found the entry 1 2 1 1 1"),
        ("1\n1\n2\n1\n2 1 1 1 1.0\n", r"found the entry 2 1 1 1 1"),
        ("1\n1\n-2\n1\n1 1 1 2 1.0\n", r"found the entry 1 1 1 2 1"),
    ],
)
def test_malformed_sdpa(tmp_path: pathlib.Path, text: str, message: str) -> None:
    path = tmp_path / "wrong.dat-s"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        sp.read_sdpa(path)


def test_numbers_of_sdpa_files_may_be_written_as_in_fortran(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "fortran.dat-s"
    path.write_text('"offset 1d1"\n1D0\n1\n-1\n2.5d0\n0 1 1 1 2.0D+0\n1 1 1 1 1d0\n')
    program = sp.read_sdpa(path)
    assert (program.offset, program.q.tolist()) == (10.0, [2.5])


def test_only_conic_programs_are_written_as_sdpa(tmp_path: pathlib.Path) -> None:
    (x,) = sp.variables(1)
    with pytest.raises(sp.ProblemError, match="found Problem, expected a ConicProgram"):
        sp.write_sdpa(sp.Problem(x), tmp_path / "x.dat-s")


def test_a_missing_sdpa_file(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FormatError, match="nowhere.dat-s: no such file"):
        sp.read_sdpa(tmp_path / "nowhere.dat-s")


# ---- MAT -------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [product, residuals])
def test_problems_as_mat(make: Any, tmp_path: pathlib.Path) -> None:
    problem = make()
    sp.write_mat(problem, tmp_path / "p.mat")
    same(sp.read_mat(tmp_path / "p.mat"), problem)
    structs = scipy.io.loadmat(tmp_path / "p.mat")
    arguments = [structs[name] for name in ("objPoly", "ineqPolySys", "lbd", "ubd")]
    assert sp.from_structs(*arguments).fingerprint == problem.fingerprint


@given(SEEDS)
@few
def test_random_problems_as_mat(tmp_path: pathlib.Path, seed: int) -> None:
    problem = random_case(seed).problem
    sp.write_mat(problem, tmp_path / "p.mat")
    same(sp.read_mat(tmp_path / "p.mat"), problem)


@pytest.mark.parametrize("tighten", [0, 1])
def test_outputs_as_mat(tmp_path: pathlib.Path, tighten: int) -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1], -1, 1, sense="max")
    param = {"printLevel": 0, "tighten": tighten, "errorBdIdx": "a", "POPsolver": "active-set"}
    output = sp.sparsePOP(problem, param)
    sp.write_mat(output, tmp_path / "out.mat")
    back = sp.read_mat(tmp_path / "out.mat")
    assert back.SDPobjValue == output.SDPobjValue
    assert np.array_equal(back.POP.xVect, output.POP.xVect)
    assert np.array_equal(back.POP.xVectL, output.POP.xVectL)
    assert back.POP.status == output.POP.status.name
    assert back.POP.certificate.verify(problem) == output.POP.certificate.verify(problem)
    assert back.SDPinfo.rowSizeA == output.SDPinfo.rowSizeA
    assert (back.SDPinfo.xIdxVec != sps.csc_array(output.SDPinfo.xIdxVec)).nnz == 0
    assert (back.param.tighten, back.param.errorBdIdx) == (tighten, "a")
    again = sp.sparsePOP(problem, {**vars(back.param), "printLevel": 0})
    assert again.param.relaxOrder == output.param.relaxOrder
    empty = sp.sparsePOP(problem, {"printLevel": 0, "SDPsolverSW": 0})
    sp.write_mat(empty, tmp_path / "empty.mat")
    assert sp.read_mat(tmp_path / "empty.mat").SDPobjValue.size == 0


def test_wrong_mat_files(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "wrong.mat"
    with pytest.raises(FormatError, match=r"nowhere.mat: expected a .mat file"):
        sp.read_mat(tmp_path / "nowhere.mat")
    for content in (b"", b"no such file" * 50):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=r"wrong.mat: expected a .mat file"):
            sp.read_mat(path)
    scipy.io.savemat(path, {"objPoly": {"typeCone": 1}, "lbd": 0.0})
    with pytest.raises(ProblemError, match=r"found objPoly without ubd"):
        sp.read_mat(path)
    with pytest.raises(ProblemError, match=r"write_mat: found SimpleNamespace, expected a Prob"):
        sp.write_mat(SimpleNamespace(), path)
    (x,) = sp.variables(1)
    with pytest.raises(ProblemError, match=r"write_mat: found the bound 1e\+12, expected less"):
        sp.write_mat(sp.Problem(x, (), -1e12), path)


def test_what_a_file_says_of_an_attained_point_is_proved_anew() -> None:
    """The least x on [0, 1] is 0, whatever value and radius a file states."""
    (x,) = sp.variables(1)
    found = json.loads(sp.to_json(sp.solve(sp.Problem(x, lower=0, upper=1))))
    found["result"]["attained"].update(value=-5.0, radius=-1.0)
    again = sp.from_json(json.dumps(found))
    assert again.attained.value == again.upper_bound == 0.0 and again.attained.radius == 0.0
