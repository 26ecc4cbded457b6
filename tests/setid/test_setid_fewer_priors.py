"""What is proved without a prior holds with it, and the evidence for it is checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
import sparsepop_py as sp

MODEL = setid.TransferFunction(3, 1, 1)
THETA = (-1.5, 0.85, -0.2, 0.7)  # poles inside the unit circle
NOISE = setid.Noise(equation=0.5)  # so wide that some ends are unstable


@pytest.fixture(scope="module")
def data() -> setid.IOData:
    """Equation errors: without the prior, linear programs settle everything exactly."""
    u = np.random.default_rng(5).uniform(-1.0, 1.0, 25)
    return setid.simulate_record(MODEL, THETA, u, setid.Noise(equation=0.02), 5).data


@pytest.fixture(scope="module")
def cut_short(data: setid.IOData) -> setid.Identification:
    """The step-up recursion makes the problem bilinear, which one relaxation leaves open."""
    options = setid.Options(engine=sp.Options(effort="plain", refine="none"), progress=False)
    return setid.identify(data, MODEL, NOISE, setid.Stable(), options)


def test_a_prior_never_widens(data: setid.IOData, cut_short: setid.Identification) -> None:
    free = setid.identify(data, MODEL, NOISE)
    assert cut_short.fewer_priors is not None and cut_short.verify(data).ok
    for name, value in zip(MODEL.parameters, THETA, strict=True):
        low, high = cut_short.intervals[name].outer
        assert free.intervals[name].outer[0] <= low <= value <= high
        assert high <= free.intervals[name].outer[1]


@pytest.mark.parametrize("others", [(), (setid.Stable(),)])
def test_products_of_a_prior_never_widen(
    data: setid.IOData, others: tuple[setid.Stable, ...]
) -> None:
    """A static gain between two numbers is a product, and two linear rows beside stability."""
    options = setid.Options(engine=sp.Options(effort="plain", refine="none"), progress=False)
    found = setid.identify(data, MODEL, NOISE, [*others, setid.DCGain(-100.0, 100.0)], options)
    free = setid.identify(data, MODEL, NOISE)
    assert found.fewer_priors is not None and not found.fewer_priors.formulation.priors
    assert found.verify(data).ok
    for name, item in free.intervals.items():
        assert item.outer[0] <= found.intervals[name].outer[0]
        assert found.intervals[name].outer[1] <= item.outer[1]


def test_the_evidence_is_kept_in_files(cut_short: setid.Identification) -> None:
    again = setid.Identification.from_json(cut_short.to_json())
    assert again.fewer_priors is not None and again.table() == cut_short.table()


def test_constraints_are_known_again_in_files(data: setid.IOData) -> None:
    """A constraint is equal only to itself, and counts in the evidence with fewer priors."""
    options = setid.Options(engine=sp.Options(effort="plain", refine="none"), progress=False)
    names = setid.parameters(MODEL)
    priors = [setid.Stable(), names["a1"] + names["b1"] <= -0.79]  # cuts the set
    found = setid.identify(data, MODEL, NOISE, priors, options)
    assert found.fewer_priors is not None and len(found.fewer_priors.formulation.priors) == 1
    text = found.to_json()
    assert setid.Identification.from_json(text).to_json() == text


def test_an_empty_set_stays_empty_with_a_prior(data: setid.IOData) -> None:
    noise = setid.Noise(equation=1e-6)
    options = setid.Options(progress=False)
    found = setid.identify(data, setid.TransferFunction(3, 1, 0), noise, setid.Stable(), options)
    assert found.empty and found.verify(data).ok


FORGED = ["wider priors", "other noise", "another statement", "a claim of its own", "a chain"]


@pytest.mark.parametrize("what", FORGED)
def test_forged_evidence_is_refused(
    data: setid.IOData, cut_short: setid.Identification, what: str
) -> None:
    claims = cut_short.evidence
    fewer = claims.fewer_priors
    assert fewer is not None
    if what == "wider priors":  # a box that was never assumed
        box = setid.Box({"b1": (0.0, 0.1)})
        forged = setid.identify(data, MODEL, NOISE, box).evidence
    elif what == "other noise":
        forged = setid.identify(data, MODEL, setid.Noise(equation=0.49)).evidence
    elif what == "another statement":  # intervals of this noise are said to be those of more
        more = setid.formulate(data, MODEL, setid.Noise(equation=0.6))
        forged = replace(fewer, formulation=more)
    elif what == "a claim of its own":
        item = replace(fewer.intervals["b1"], outer=(0.2, 1.2))
        forged = replace(fewer, intervals={**fewer.intervals, "b1": item})
    else:
        forged = replace(fewer, fewer_priors=fewer)
    assert not setid.verify(replace(claims, fewer_priors=forged)).ok


def test_ends_that_the_evidence_does_not_give_are_refused(
    cut_short: setid.Identification,
) -> None:
    claims = cut_short.evidence
    item = claims.intervals["a1"]
    tighter = replace(item, outer=(item.outer[0], float(np.nextafter(item.outer[1], -9.0))))
    assert not setid.verify(replace(claims, intervals={**claims.intervals, "a1": tighter})).ok


def test_denominators_that_are_multiplied_out_are_so_without_a_prior_too() -> None:
    """Fewer priors make the problem of partial outputs linear, whose rows are others."""
    u = np.array([[1, 2], [-1, 1], [2, -1], [1, 1], [-2, 3], [1, -1], [2, 2], [-1, -2]])
    y = np.convolve(u[:, 0], [0, 2])[:8] + np.convolve(u[:, 1], [0, 1, -0.5])[:8]
    model = setid.TransferFunction([[0, 0]], [[1, 2]], [[1, 1]], inputs=2, form="partial")
    noise = setid.Noise(output=np.where(np.arange(8) == 5, 0.25, 0.0))
    zero = setid.ZeroIn(0.2, 0.8, output=1, input=2)
    found = setid.identify(setid.IOData(u, y), model, noise, zero, setid.Options(progress=False))
    assert found.fewer_priors is not None
    assert found.fewer_priors.formulation.model == found.formulation.model
    assert found.verify().ok
    assert setid.Identification.from_json(found.to_json()).table() == found.table()
