"""Forged evidence, one forgery for each check: ``verify`` refuses what does not follow.

Each forgery claims something false about the record of four samples, or rests on a proof that
is missing. The true intervals of the equation-error set are the closed form of the vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest
from prior_cases import Never

import setid
import sparsepop_py as sp
from setid.identify import identify
from setid.proofs.evidence import EndProof, Evidence
from setid.proofs.intervals import IntervalStatus, ParameterInterval, overstated
from setid.proofs.verification import _reached, verify
from sparsepop_py.verified.arithmetic import interval as rounding

DATA = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
FIRST = setid.TransferFunction(na=1, nb=1)
QUIET = setid.Options(progress=False)


def found(noise: setid.Noise, priors: Any = (), data: setid.IOData = DATA) -> Evidence:
    return identify(data, FIRST, noise, priors, QUIET).evidence


@pytest.fixture(scope="module")
def linear() -> Evidence:
    return found(setid.Noise(equation=0.5))


@pytest.fixture(scope="module")
def bilinear() -> Evidence:
    return found(setid.Noise(output=0.5))


@pytest.fixture(scope="module")
def reported() -> Evidence:
    u = np.linspace(-1.0, 1.0, 9)
    model = setid.Hammerstein(setid.TransferFunction(1, 1), 2)
    options = setid.Options(unidentifiable="report", progress=False)
    y = np.zeros(9)
    for k in range(9):
        y[k] = (0.5 * y[k - 1] if k else 0.0) + u[k] + 0.5 * u[k] ** 2
    noise = setid.Noise(equation=0.01)
    return identify(setid.IOData(u, y), model, noise, (), options).evidence


def with_interval(claims: Evidence, name: str, **changes: Any) -> Evidence:
    item = replace(claims.intervals[name], **changes)
    return replace(claims, intervals={**claims.intervals, name: item})


def nudged(claims: Evidence, name: str, which: str, end: int, inwards: bool) -> Evidence:
    """Move one end by a billionth, to where it claims too much."""
    ends = list(getattr(claims.intervals[name], which))
    ends[end] += 1e-9 if (end == 0) == inwards else -1e-9
    return with_interval(claims, name, **{which: tuple(ends)})


@pytest.mark.parametrize("change", [lambda a: a[:, None], lambda a: a[:1], lambda a: a[None]])
def test_arrays_of_other_shapes_prove_nothing_and_raise_nothing(change: Callable[..., Any]) -> None:
    """Boxes and points whose arrays would be spread over others, and the same by keyword."""
    evidence = found(setid.Noise(output=0.5))
    assert evidence.box is not None and verify(evidence)
    (first, *others), points = evidence.ends, [end.attained for end in evidence.ends]
    assert points[0] is not None
    damaged = first._replace(attained=replace(points[0], x=points[0].x[:1]))
    for forged in (
        replace(evidence, box=replace(evidence.box, lower=change(evidence.box.lower))),
        replace(evidence, ends=(damaged, *others)),
    ):
        assert not verify(forged) and not verify(claims=forged)


def test_processes_that_flush_subnormal_numbers_verify_nothing(linear, monkeypatch):
    """Not even that a record is another one: closed forms of some proofs ask no further."""
    other = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.5])
    assert verify(linear) and not verify(linear, other)
    monkeypatch.setattr(rounding, "_TINY", 0.0)  # what a flushed product looks like
    for record in (None, other):
        with pytest.raises(FloatingPointError, match="IEEE"):
            verify(linear, record)


# ---- all kinds of evidence ------------------------------------------------------------------


def test_true_evidence_is_accepted(
    linear: Evidence, bilinear: Evidence, reported: Evidence
) -> None:
    for claims in (linear, bilinear, reported):
        assert verify(claims).ok, verify(claims).reason


def test_evidence_of_other_data_is_refused(linear: Evidence) -> None:
    other = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0])
    assert not verify(linear, other).ok


def test_names_may_not_be_exchanged(linear: Evidence) -> None:
    a1, b0 = linear.intervals["a1"], linear.intervals["b0"]
    for exchanged in (
        {"b0": replace(a1, name="b0"), "a1": replace(b0, name="a1")},
        {"a1": replace(a1, name="b0"), "b0": replace(b0, name="a1")},
        {"a1": a1},
    ):
        assert not verify(replace(linear, intervals=exchanged)).ok


@pytest.mark.parametrize("kind", ["linear", "bilinear"])
@pytest.mark.parametrize("name", ["a1", "b0"])
@pytest.mark.parametrize("end", [0, 1])
def test_no_outer_end_may_be_tighter_than_what_follows(
    request: pytest.FixtureRequest, kind: str, name: str, end: int
) -> None:
    claims = request.getfixturevalue(kind)
    assert not verify(nudged(claims, name, "outer", end, inwards=True)).ok


@pytest.mark.parametrize("kind", ["linear", "bilinear"])
@pytest.mark.parametrize("which", ["outer", "inner"])
def test_ends_are_numbers(request: pytest.FixtureRequest, kind: str, which: str) -> None:
    """Nothing is larger than NaN, so that a comparison alone lets it pass."""
    claims = request.getfixturevalue(kind)
    assert not verify(with_interval(claims, "a1", **{which: (float("nan"), float("nan"))})).ok


@pytest.mark.parametrize("kind", ["linear", "bilinear"])
@pytest.mark.parametrize("name", ["a1", "b0"])
@pytest.mark.parametrize("end", [0, 1])
def test_no_inner_end_may_be_wider_than_what_is_attained(
    request: pytest.FixtureRequest, kind: str, name: str, end: int
) -> None:
    claims = request.getfixturevalue(kind)
    assert not verify(nudged(claims, name, "inner", end, inwards=False)).ok


def test_a_set_with_members_is_not_empty(linear: Evidence, bilinear: Evidence) -> None:
    for claims in (linear, bilinear):
        items = {
            name: replace(item, outer=(inf, -inf), inner=None, status=IntervalStatus.EMPTY)
            for name, item in claims.intervals.items()
        }
        assert not verify(replace(claims, intervals=items)).ok


# ---- linear bounds ----------------------------------------------------------------------------


def test_linear_bounds_are_complete_and_checked(linear: Evidence) -> None:
    assert not verify(replace(linear, bounds=linear.bounds[:2])).ok
    moved = found(setid.Noise(equation=0.4)).bounds
    assert not verify(replace(linear, bounds=(moved[0], *linear.bounds[1:]))).ok


def unbounded_line() -> Evidence:
    """The input alternates, so that b0 - b1 alone is seen: whole lines are consistent."""
    data = setid.IOData([1.0, -1.0, 1.0], [0.0, 0.0, 0.0])
    model = setid.TransferFunction(na=0, nb=2)
    return identify(data, model, setid.Noise(equation=0.5), (), QUIET).evidence


@pytest.mark.parametrize("status", [IntervalStatus.UNBOUNDED, IntervalStatus.UNIDENTIFIABLE])
def test_bounded_linear_parameters_are_not_unbounded(
    linear: Evidence, status: IntervalStatus
) -> None:
    assert str(unbounded_line().intervals["b0"].status) == "unidentifiable"
    assert not verify(with_interval(linear, "b0", status=status)).ok


def test_a_ray_on_one_side_is_not_a_line() -> None:
    claims = identify(
        setid.IOData([1.0, -1.0, 1.0], [0.0, 0.0, 0.0]),
        setid.TransferFunction(na=0, nb=2),
        setid.Noise(equation=0.5),
        setid.Box({"b0": (0.0, None)}),
        QUIET,
    ).evidence
    assert str(claims.intervals["b0"].status) == "unbounded" and verify(claims).ok
    status = IntervalStatus.UNIDENTIFIABLE
    assert not verify(with_interval(claims, "b0", status=status)).ok


# ---- boxes, certificates and points -------------------------------------------------------------


def test_boxes_are_checked(bilinear: Evidence) -> None:
    other = found(setid.Noise(output=0.4))
    assert not verify(replace(bilinear, box=other.box)).ok
    assert not verify(replace(bilinear, problem=other.problem)).ok


def test_an_empty_box_proves_no_interval() -> None:
    claims = found(setid.Noise(output=0.01))
    assert claims.box is not None and claims.box.empty and claims.empty and verify(claims).ok
    items = {
        name: replace(item, outer=(0.0, 1.0), status=IntervalStatus.PARTIAL)
        for name, item in claims.intervals.items()
    }
    assert not verify(replace(claims, intervals=items)).ok


def test_ends_are_complete_and_their_proofs_checked(bilinear: Evidence) -> None:
    ends = bilinear.ends
    assert not verify(replace(bilinear, ends=ends[:2])).ok
    assert not verify(replace(bilinear, ends=(*ends, ends[0]))).ok
    assert not verify(replace(bilinear, ends=())).ok  # the box alone is wider
    swapped = EndProof(ends[1].certificate, ends[0].attained)
    assert not verify(replace(bilinear, ends=(swapped, *ends[1:]))).ok
    for number, end in enumerate(ends):
        missing = (*ends[:number], EndProof(None, end.attained), *ends[number + 1 :])
        name = ("a1", "b0")[number // 2]
        side = number % 2
        wide = list(bilinear.intervals[name].outer)
        assert bilinear.box is not None
        if (bilinear.box.lower, bilinear.box.upper)[side][number // 2] != wide[side]:
            assert not verify(replace(bilinear, ends=missing)).ok


def test_attained_points_are_proved_again(bilinear: Evidence) -> None:
    for number, end in enumerate(bilinear.ends):
        point = end.attained
        assert point is not None
        far = replace(point, x=point.x + 1.0)
        ends = list(bilinear.ends)
        ends[number] = EndProof(end.certificate, far)
        assert not verify(replace(bilinear, ends=tuple(ends))).ok


def test_the_radius_of_a_point_counts() -> None:
    """The point is somewhere within the radius: x_1 reaches 0.75, -x_1 reaches -0.25 at least."""
    x = sp.variables(1)[0]
    problem = sp.Problem(x, [], 0.0, 1.0)
    none = np.zeros(0, dtype=np.int64)
    point = sp.ProvedPoint(np.array([0.5]), 0.75, 0.25, "krawczyk", none, none)
    assert _reached(problem, point, 0) >= 0.75 and _reached(problem, point, 1) >= -0.25


# ---- parameters without bounds ------------------------------------------------------------------


def test_unbounded_parameters_need_a_proof(bilinear: Evidence) -> None:
    data = setid.IOData([1, 0, -1, 1, 0, 1], [2.1, 0, -1.9, 2, 0.1, 2])
    model = setid.TransferFunction(1, 2)
    claims = identify(data, model, setid.Noise(output=0.2), (), QUIET).evidence
    assert claims.unbounded is not None and verify(claims).ok
    assert not verify(replace(claims, unbounded=None)).ok
    assert not verify(with_interval(claims, "b0", status=IntervalStatus.UNBOUNDED)).ok
    forged = replace(bilinear, unbounded=claims.unbounded)
    for status in (IntervalStatus.UNBOUNDED, IntervalStatus.UNIDENTIFIABLE):
        for base in (bilinear, forged):
            assert not verify(with_interval(base, "a1", status=status)).ok


def test_points_of_linear_problems_are_what_priors_mean(linear: Evidence) -> None:
    """Rows of the prior are those of none: what is proved holds, nothing is attained."""
    given = linear.formulation
    less = setid.formulate(given.data, given.model, given.noise, [Never()])
    assert less.problem.fingerprint == given.problem.fingerprint
    assert not verify(replace(linear, formulation=less)).ok
    other = identify(DATA, FIRST, given.noise, [Never()], QUIET)
    assert other.verify().ok
    for name, item in other.intervals.items():
        low, high = linear.intervals[name].outer
        assert item.inner is None and item.outer[0] <= low and high <= item.outer[1]
    least = setid.consistency(DATA, FIRST, given.noise, [Never()], QUIET)
    assert least.scale[1] == inf and least.verify().ok


def test_rows_of_jurys_criterion_say_all_up_to_order_two() -> None:
    u = np.random.default_rng(2).uniform(-1.0, 1.0, 15)
    model = setid.TransferFunction(2, 1, 1)
    data = setid.IOData(u, setid.simulate(model, [-1.6, 0.97, 0.5], u))
    made = [
        identify(data, model, setid.Noise(equation=0.3), [setid.Stable(form=form)], QUIET)
        for form in ("step-up", "jury")
    ]
    assert [str(item.intervals) for item in made[:1]] == [str(item.intervals) for item in made[1:]]
    assert made[1].intervals["a2"].inner == (pytest.approx(0.29500094, abs=1e-7), 1.0)
    assert made[1].bounds and made[1].verify().ok


# ---- evidence with a normalisation --------------------------------------------------------------


def other_reference(reported: Evidence, noise: float) -> Evidence:
    """Evidence of the same reference structure with other noise."""
    assert reported.reference is not None
    model = reported.reference.formulation.model
    data = reported.formulation.data
    return identify(data, model, setid.Noise(equation=noise), (), QUIET).evidence


def taking_over(claims: Evidence, reference: Evidence) -> Evidence:
    """Claim the intervals of a reference, except of what is not unique."""
    items = {
        name: item
        if str(item.status) == "unidentifiable"
        else replace(reference.intervals[name], witnesses=(None, None))
        for name, item in claims.intervals.items()
    }
    return replace(claims, reference=reference, intervals=items)


def test_a_reference_needs_its_proof(reported: Evidence) -> None:
    assert reported.reference is not None and reported.nonzero is not None
    assert verify(taking_over(reported, reported.reference)).ok
    assert not verify(replace(reported, nonzero=None)).ok


FORGERIES: dict[str, Callable[[Evidence], Evidence]] = {
    "other noise": lambda claims: taking_over(claims, other_reference(claims, 0.005)),
    "an interval of its own": lambda claims: with_interval(claims, "a1", outer=(-0.5, -0.5)),
    "emptiness of its own": lambda claims: replace(
        claims,
        intervals={
            name: replace(item, outer=(inf, -inf), inner=None, status=IntervalStatus.EMPTY)
            for name, item in claims.intervals.items()
        },
    ),
    "a believed reference": lambda claims: taking_over(
        claims,
        with_interval(claims.reference, "a1", outer=(-0.5, -0.5)),  # type: ignore[arg-type]
    ),
    "a linear structure": lambda claims: replace(
        claims, reference=found(setid.Noise(equation=0.5))
    ),
}


def test_points_of_a_reference_are_what_priors_mean() -> None:
    """Claims with a prior of which the reference knows nothing."""
    model = setid.Hammerstein(setid.TransferFunction(0, 1), 2)
    u = np.array([1.0, -1.0, 0.5, -0.5, 1.0, 0.2])
    options = setid.Options(unidentifiable="report", progress=False)
    claims = identify(
        setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(equation=0.05), (), options
    ).evidence
    given = claims.formulation
    less = setid.formulate(given.data, given.model, given.noise, [Never()])
    assert verify(claims).ok and not verify(replace(claims, formulation=less)).ok


def test_a_reference_states_the_noise_of_the_claims(reported: Evidence) -> None:
    assert reported.reference is not None and verify(reported).ok
    known = reported.reference.formulation
    other = setid.formulate(known.data, known.model, setid.Noise(equation=1.0))
    forged = replace(reported, reference=replace(reported.reference, formulation=other))
    assert verify(forged).reason == "the reference is not that of the data"


@pytest.mark.parametrize("what", FORGERIES)
def test_references_are_checked(reported: Evidence, what: str) -> None:
    assert not verify(FORGERIES[what](reported)).ok


def test_bounds_for_each_sample_are_those_of_one_record() -> None:
    """With 12 bounds nothing is said of a record of 20 samples."""
    u = np.random.default_rng(2).uniform(-1.0, 1.0, 20)
    whole = setid.IOData(u, np.append(0.0, 0.5 * u[:-1]))
    part = whole.split(12)[0]
    model, noise = setid.TransferFunction(0, 1, 1), setid.Noise(equation=np.full((12, 1), 0.1))
    result = setid.identify(part, model, noise)
    assert result.verify(part).ok
    verdict = result.verify(whole)
    assert not verdict.ok and "another record" in verdict.reason


@pytest.mark.parametrize("status", [IntervalStatus.UNBOUNDED, IntervalStatus.UNIDENTIFIABLE])
def test_words_about_a_parameter_are_those_of_the_reference(
    reported: Evidence, status: IntervalStatus
) -> None:
    """Wide ends follow for a1, and say nothing of values of any size."""
    assert reported.reference is not None
    wide: dict[str, Any] = {"outer": (-inf, inf), "inner": None}
    weak = with_interval(reported.reference, "a1", **wide, status=IntervalStatus.PARTIAL)
    claims = with_interval(replace(reported, reference=weak), "a1", **wide, status=status)
    assert not verify(claims).ok
    assert verify(with_interval(claims, "a1", status=IntervalStatus.PARTIAL)).ok


# ---- emptiness ------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [setid.Noise(equation=0.01), setid.Noise(output=0.01)])
@pytest.mark.parametrize(
    "changes",
    [
        {"inner": (0.25, 0.5), "outer": (0.0, 1.0), "status": IntervalStatus.CERTIFIED},
        {"inner": (0.25, 0.5)},
        {"outer": (0.0, 1.0)},
        {"status": IntervalStatus.UNBOUNDED},
    ],
)
def test_where_nothing_is_consistent_no_parameter_has_values(
    noise: setid.Noise, changes: dict[str, Any]
) -> None:
    claims = found(noise)
    assert claims.empty and verify(claims).ok
    assert not verify(with_interval(claims, "b0", **changes)).ok


def test_programs_that_are_infeasible_attain_nothing() -> None:
    """Each claims that its objective falls without limit, so that any interval is attained."""
    claims = found(setid.Noise(equation=0.01))
    falling = tuple(replace(bound, lower=-1.0, upper=-inf) for bound in claims.bounds)
    claims = replace(claims, bounds=falling)
    for name in claims.intervals:
        open_: dict[str, Any] = {"outer": (-1.0, 1.0), "inner": (-0.5, 0.5)}
        claims = with_interval(claims, name, **open_, status=IntervalStatus.PARTIAL)
    assert not verify(claims).ok


# ---- words ----------------------------------------------------------------------------------


def test_intervals_without_attained_ends_are_not_certified(
    linear: Evidence, bilinear: Evidence, reported: Evidence
) -> None:
    for claims in (linear, bilinear):
        assert verify(with_interval(claims, "b0", inner=None, status=IntervalStatus.PARTIAL)).ok
        assert not verify(with_interval(claims, "b0", inner=None)).ok
    assert not verify(with_interval(reported, "b0", status=IntervalStatus.CERTIFIED)).ok


def test_a_result_of_a_part_says_what_verifies_it(linear: Evidence) -> None:
    whole = setid.IOData([4, -3, 2, 1, 1], [0, -6.25, 1.175, 2.0875, 1.0])
    other = setid.IOData([4, -3, 2, 2], [0, -6.25, 1.175, 2.0875])
    assert "it has 4 samples, this record 5; result.verify()" in verify(linear, whole).reason
    assert verify(linear, other).reason == "the result belongs to other data"


def interval(outer: tuple[float, float], inner: tuple[float, float] | None) -> ParameterInterval:
    return ParameterInterval("a1", outer, inner, IntervalStatus.CERTIFIED)


@pytest.mark.parametrize(
    ("outer", "inner", "tol", "near"),
    [
        ((0.0, 1.0), (0.0, 1.0), 0.0, True),
        ((-0.01, 1.0), (0.0, 1.0), 0.01, True),
        ((0.0, 1.01), (0.0, 1.0), 0.01, True),
        ((-0.02, 1.0), (0.0, 1.0), 0.01, False),
        ((0.0, 1.02), (0.0, 1.0), 0.01, False),
        ((0.0, 1.0 + 1e-7), (0.0, 1.0), 1e-9, False),
        ((0.0, 1.0 + 1e-7), (1.0, 1.0), 1e-3, False),
        ((1.0, 1.0 + 1e-10), (1.0, 1.0), 0.0, True),
        ((1.0, 1.0 + 1e-8), (1.0, 1.0), 0.0, False),
        ((0.0, np.inf), (0.0, 1.0), 1e300, False),
    ],
)
def test_ends_agree_on_both_sides(
    outer: tuple[float, float], inner: tuple[float, float], tol: float, near: bool
) -> None:
    found = interval(outer, inner)
    assert found.agrees(tol) == near
    assert bool(overstated({"a": interval((0, 1), (0, 1)), "b": found}, tol)) != near
    if inner[1] > inner[0] and np.isfinite(outer[1]):
        loose = max(inner[0] - outer[0], outer[1] - inner[1])
        assert found.gap == loose / (inner[1] - inner[0])


def test_ends_are_shown_rounded_outwards_and_attained_ones_inwards() -> None:
    third = interval((1 / 3, 2 / 3), (1 / 3, 2 / 3))
    assert repr(third) == "a1 in [0.333333, 0.666667], attained [0.333334, 0.666666], certified"
