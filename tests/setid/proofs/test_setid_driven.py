"""Rows with an offset of the equation: against given poles, with forged evidence, from files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize
from scipy.signal import lfilter
from slow_values import slow_after

import setid
from checker.records.record import Identification as Checked
from setid.data.checks import FrozenMapping
from setid.formulation.formulation import formulate, without_partial_outputs
from setid.proofs.driven import driven, within_driven
from setid.proofs.evidence import Evidence
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import problem_on_box
from setid.proofs.verification import verify
from setid.result.certificate_files import certificate_files

MODEL = setid.TransferFunction(1, 1, 1, inputs=2, offset=True)
THETA, NOISE = [-0.8, -0.5, 1.0, 0.6, 3.0], setid.Noise(output=0.05)
FINE = {"xatol": 1e-7, "fatol": 1e-9, "maxiter": 400}


def record(count: int = 30, seed: int = 1) -> setid.IOData:
    """A sum of two systems of order 1 and an offset, not at rest."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.0, 1.0, (count + 30, 2))
    whole = setid.simulate_record(MODEL, THETA, u, NOISE, rng).data
    return setid.IOData(whole.u[30:], whole.y[30:])


def ends_for(poles: np.ndarray, data: setid.IOData, place: int, sign: float) -> float:
    """The least of one of b, b', c for two poles: a linear program that knows no rows."""
    k = np.arange(data.samples)
    columns = [lfilter([0, 1], [1, -p], u) for p, u in zip(poles, data.u.T, strict=True)]
    columns += [np.ones(data.samples), *(p**k for p in poles)]
    slopes, y = np.column_stack(columns), data.y[:, 0]
    below = np.concatenate([y + 0.05, 0.05 - y])
    cost = sign * np.eye(5)[place]
    found = linprog(cost, np.vstack([slopes, -slopes]), below, bounds=(None, None))
    return float(found.fun) if found.status == 0 else math.inf


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    options = setid.Options(time_limit=60, tol=1e-2)
    return setid.identify(record(), MODEL, NOISE, [setid.Stable()], options)


def test_all_parameters_are_certified_without_a_box(result: setid.Identification) -> None:
    """With poles up to 1 the data bound c through the others alone."""
    assert str(result.status) == "certified" and result.verify()
    assert result.driven is not None and result.driven.formulation.model.form == "driven"
    for value, item in zip(THETA, result.intervals.values(), strict=True):
        assert item.outer[0] <= value <= item.outer[1]


@pytest.mark.parametrize("place", slow_after(2, [0, 2, 1]))
def test_ends_are_those_of_programs_for_given_poles(
    result: setid.Identification, place: int
) -> None:
    """A search over poles in [-1, 1], from several starts, ends at the proved ends."""
    data, item = record(), list(result.intervals.values())[2 + place]
    for sign, end in ((1.0, item.outer[0]), (-1.0, item.outer[1])):

        def least(poles: np.ndarray, sign: float = sign) -> float:
            inside = np.all(np.abs(poles) <= 1.0)
            return ends_for(poles, data, place, sign) if inside else math.inf

        starts = [[0.8, 0.5], [0.79, 0.51]]
        ends = [minimize(least, p, method="Nelder-Mead", options=FINE).fun for p in starts]
        width = item.outer[1] - item.outer[0]
        assert min(ends) >= sign * end - 1e-9 * width
        assert min(ends) <= sign * end + 2e-2 * width


def test_files_keep_the_rows(result: setid.Identification) -> None:
    back = setid.Identification.from_json(result.to_json())
    assert back.driven is not None and back.verify()
    assert back.intervals["c"].outer == result.intervals["c"].outer


def changed(result: setid.Identification, name: str, outer: tuple[float, float]) -> Evidence:
    """The evidence with an interval of the rows changed, and what follows for the problem."""
    found = result.evidence
    assert found.driven is not None
    items = dict(found.driven.intervals)
    items[name] = ParameterInterval(name, outer, None, IntervalStatus.PARTIAL)
    own = replace(found.driven, intervals=FrozenMapping(items))
    problem = within_driven(
        problem_on_box(found.formulation, found.box),
        found.formulation,
        items,
    )
    return replace(found, driven=own, problem=problem)


def test_forged_rows_are_noticed(result: setid.Identification) -> None:
    assert result.driven is not None
    low, high = result.driven.intervals["b[1,1]1"].outer
    same = changed(result, "b[1,1]1", (low, high))
    assert "b[1,1]1" not in verify(same).reason
    narrow = changed(result, "b[1,1]1", (low, 0.5 * (low + high)))
    assert not verify(narrow)
    evidence = result.evidence
    assert not verify(replace(evidence, driven=None))
    assert not verify(replace(evidence, driven=replace(evidence.driven, driven=evidence.driven)))
    assert not verify(replace(evidence, driven=evidence))
    known = evidence.driven.formulation
    fewer = formulate(known.data, known.model, known.noise)  # stability is not said to be given
    assert not verify(replace(evidence, driven=replace(evidence.driven, formulation=fewer)))


def test_rows_with_more_priors_are_not_those_of_the_question(result: setid.Identification) -> None:
    """What holds with a box of b holds for nobody who gave none."""
    found, p = result.evidence, len(result.intervals)
    narrow = [setid.Stable(), setid.Box({"b[1,1]1": (1.0, 1.0001)})]
    model = replace(MODEL, form="driven")
    options = setid.Options(time_limit=30, tol=0.1)
    other = setid.identify(record(), model, NOISE, narrow, options).evidence
    assert verify(other)
    plain = problem_on_box(found.formulation, found.box)
    problem = within_driven(plain, found.formulation, other.intervals)
    ends = zip(result.intervals, problem.lower[:p], problem.upper[:p], strict=True)
    items = {n: ParameterInterval(n, (a, b), None, IntervalStatus.PARTIAL) for n, a, b in ends}
    forged = replace(found, driven=other, problem=problem, ends=(), intervals=FrozenMapping(items))
    assert not verify(forged)


def test_rows_are_stated_where_they_say_more() -> None:
    data = record()

    def stated(model: setid.TransferFunction, noise: setid.Noise = NOISE, priors: object = ()):
        return driven(formulate(data, model, noise, priors))

    fields = {"inputs": 2, "offset": True}
    for form in ("auto", "partial", "multiplied", "lifted"):
        found = stated(setid.TransferFunction(1, 1, 1, form=form, **fields))
        assert found is not None and found.model.form == "driven"
    assert stated(setid.TransferFunction(1, 1, 1, initial="zero", **fields)).model.initial == "free"
    for form in ("direct", "driven"):
        assert stated(setid.TransferFunction(1, 1, 1, form=form, **fields)) is None
    assert stated(setid.TransferFunction(1, 1, 1, inputs=2)) is None
    assert stated(setid.TransferFunction(2, 1, 1, common_denominator=True, **fields)) is None
    lifted = setid.TransferFunction(1, 1, 1, form="lifted", **fields)
    assert stated(lifted, setid.Noise(output=0.05, equation=0.01)) is None


def test_priors_of_an_offset_are_left_out() -> None:
    """c and the offset of the equation are two things: bounds of one are none of the other."""
    lifted = setid.TransferFunction(1, 1, 1, inputs=2, offset=True, form="lifted")
    c, a = (setid.parameters(lifted)[name] for name in ("c", "a[1,1]1"))
    own, other = c - a >= 0, a + 0.5 >= -1
    priors = [setid.Box({"c": (0, 9)}), setid.Box({"a[1,1]1": (-1, 0)}), own, other, setid.Stable()]
    found = driven(formulate(record(), lifted, NOISE, priors))
    assert found is not None
    texts = [prior.describe() for prior in found.priors]
    assert len(texts) == 3 and not any("c" in found.model.parameters and "'c'" in t for t in texts)
    place = found.parameters.index("c")
    assert (found.problem.lower[place], found.problem.upper[place]) == (-math.inf, math.inf)


def test_an_offset_is_the_quotient() -> None:
    """d in [1, 2] and (1 + a)(1 + a') in [.25, 1] bound c by [1, 8]; zero inside by nothing."""
    formulation = without_partial_outputs(formulate(record(), MODEL, NOISE, setid.Stable()))

    def bounds(a: tuple[float, float]) -> tuple[float, float]:
        ends = dict(zip(formulation.parameters, [a, a, (0, 1), (0, 1), (1, 2)], strict=True))
        items = {n: ParameterInterval(n, e, None, IntervalStatus.PARTIAL) for n, e in ends.items()}
        problem = within_driven(formulation.problem, formulation, items)
        assert (problem.lower[2], problem.upper[2]) == (0.0, 1.0)
        return float(problem.lower[4]), float(problem.upper[4])

    low, high = bounds((-0.5, 0.0))
    assert low <= 1.0 <= 8.0 <= high
    assert math.isclose(low, 1.0, rel_tol=1e-12) and math.isclose(high, 8.0, rel_tol=1e-12)
    assert bounds((-1.0, 0.0)) == (-math.inf, math.inf)


@pytest.mark.slow
def test_noise_too_small_is_refuted() -> None:
    small = setid.Noise(output=0.035)  # the least is .0435, see the next test
    found = setid.identify(record(), MODEL, small, [setid.Stable()], setid.Options(time_limit=60))
    assert found.empty and found.driven is not None and found.verify()
    back = setid.Identification.from_json(found.to_json())
    assert back.empty and back.verify()
    lines = Checked(certificate_files(found)["identification"]).check()
    assert lines[-1] == "proved: no parameters explain the record"
    assert not verify(replace(found.evidence, driven=None))


@pytest.mark.slow
def test_the_least_noise_is_that_of_programs_for_given_poles() -> None:
    """Linear programs for poles in [-1, 1], which know nothing of rows."""
    data = record()
    found = setid.consistency(data, MODEL, setid.Noise(output=1.0), [setid.Stable()])

    def least(poles: np.ndarray) -> float:
        if np.any(np.abs(poles) > 1.0):
            return math.inf
        k, y = np.arange(data.samples), data.y[:, 0]
        columns = [lfilter([0, 1], [1, -p], u) for p, u in zip(poles, data.u.T, strict=True)]
        slopes = np.column_stack([*columns, np.ones(k.size), *(p**k for p in poles)])
        one = np.ones((k.size, 1))
        below = np.block([[slopes, -one], [-slopes, -one]])
        cost, right = np.append(np.zeros(5), 1.0), np.concatenate([y, -y])
        return float(linprog(cost, below, right, bounds=(None, None)).fun)

    best = minimize(least, [0.8, 0.5], method="Nelder-Mead", options=FINE).fun
    low, high = found.scale
    assert low <= best * (1 + 1e-9) and best <= high * (1 + 1e-9)
    assert high - low < 2e-3 * high and found.verify()
    assert any("drives the equation" in text for text in found.assumptions)
    assert "c of the equation = " in found.summary()


def test_what_is_given_of_an_offset_keeps_it() -> None:
    """A bound of c is none of the offset of the equation."""
    priors = [setid.Stable(), setid.Box({"c": (2.5, 3.5)})]
    found = setid.consistency(record(14), MODEL, setid.Noise(output=1.0), priors)
    assert found.formulation.model.form == "lifted" and found.verify()
    assert found.theta is not None and 2.5 <= found.theta[4] <= 3.5


def test_offsets_that_nothing_bounds_stay_so() -> None:
    """Strong noise leaves poles at 1: the others have finite intervals, and c has none."""
    noise = setid.Noise(output=1.5)
    options = setid.Options(time_limit=1)
    found = setid.identify(record(), MODEL, noise, [setid.Stable()], options)
    assert found.verify() and found.intervals["c"].outer == (-math.inf, math.inf)
    assert all(np.all(np.isfinite(found.intervals[n].outer)) for n in found.intervals if n != "c")
    assert any("where a pole may be at 1" in note for note in found.notes)
