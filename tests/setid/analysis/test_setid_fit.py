"""Fits and their evidence belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import setid


def test_a_fit_and_its_evidence_belong_together() -> None:
    """Each forgery once verified: another structure, other parameters, NaN, another layout."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 15)
    y = setid.simulate(setid.TransferFunction(2, 1, 1), [-1.2, 0.5, 1.0], u)
    data = setid.IOData(u, y)
    small = setid.fit(data, setid.TransferFunction(1, 1, 1), "linf")
    assert small.verify(data).ok and small.evidence is not None and small.attained
    large = setid.fit(data, setid.TransferFunction(2, 1, 1), "linf")
    forged = [
        replace(large, lower_bound=small.lower_bound, error=small.error, evidence=small.evidence),
        replace(small, theta=small.theta + 1.0),
        replace(small, norm="l1"),
        replace(small, lower_bound=float("nan")),
        replace(small, error=float("nan")),
    ]
    assert not any(found.verify(data).ok for found in forged)
    known = small.evidence
    layout = known.formulation.layout
    groups = {**layout.groups, "eta": np.append(layout.groups["eta"].ravel(), 0)[:, None]}
    other = replace(known.formulation, layout=replace(layout, groups=groups))
    assert replace(small, evidence=replace(known, formulation=other)).verify(data).ok


def test_what_a_fit_claims_is_checked_word_by_word() -> None:
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 15)
    data = setid.IOData(u, setid.simulate(setid.TransferFunction(2, 1, 1), [-1.2, 0.5, 1.0], u))
    model = setid.TransferFunction(1, 1, 1)
    equation = setid.fit(data, model, "linf", errors="equation")
    assert equation.verify(data).ok
    assert not replace(equation, error=float("nan")).verify(data).ok
    output = setid.fit(data, model, "linf")
    assert output.attained
    bare = replace(output, evidence=None, attained=False)
    assert replace(bare, lower_bound=0.0).verify(data).ok
    assert not replace(bare, lower_bound=1e-3).verify(data).ok
    assert not replace(output, evidence=None, lower_bound=0.0).verify(data).ok
    wrong = "the evidence is of another structure, norm or kind of error"
    rest = setid.TransferFunction(1, 1, 1, initial="zero")  # has the same names of parameters
    assert replace(output, model=rest).verify(data).reason == wrong
    assert replace(output, errors="equation").verify(data).reason == wrong
