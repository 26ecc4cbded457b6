"""Prices of relaxations: what cliques share is counted once."""

import itertools

import pytest

import sparsepop_py as sp
from sparsepop_py.relaxation.hierarchy import (
    Families,
    RelaxationSpec,
    expected_seconds,
    relaxation_specs,
)
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling


def _price(pairs: list[tuple[int, int]], n: int, order: int) -> tuple[float, sp.Cliques]:
    """Price a full order of a problem on the unit box whose objective holds these products."""
    x = sp.variables(n)
    problem = sp.Problem(sp.total([x[i] * x[j] for i, j in pairs]), lower=-1.0, upper=1.0)
    box = Interval(problem.lower, problem.upper)
    scaled = Scaled.of(problem, Scaling.of_box(box), (problem.objective,))
    cliques = Families(problem, (problem.objective,), True, "auto")
    spec = RelaxationSpec("order", 0.5, order=order)
    return spec.seconds(scaled, cliques), cliques["constraints"]


def _apart(side: int, bounds: int, count: int) -> float:
    """Price that many cliques apart: a block each, and a row for each bound."""
    sizes = {side: float(count), 1: float(count * bounds)}
    rows = side * (side + 1) / 2 * count + count * bounds
    return expected_seconds(sizes, rows)


def test_one_clique_is_priced_by_its_block() -> None:
    found, cliques = _price(list(itertools.combinations(range(9), 2)), 9, 1)
    assert len(cliques.members) == 1
    assert found == pytest.approx(_apart(10, 9, 1))


@pytest.mark.parametrize("width", [15, 25])
def test_overlap_of_wide_cliques_is_counted_once(width: int) -> None:
    n = 2 * width
    band = [(i, j) for i in range(n) for j in range(i + 1, min(n, i + width))]
    found, cliques = _price(band, n, 1)
    assert {len(members) for members in cliques.members} == {width}
    assert found < 0.2 * _apart(width + 1, width, len(cliques.members))


def test_cliques_that_share_little_cost_no_more_than_apart() -> None:
    chain = list(itertools.pairwise(range(30)))
    found, cliques = _price(chain, 30, 2)
    assert len(cliques.members) == 29
    assert 0.0 < found <= expected_seconds({6: 29.0, 3: 58.0}, 29 * 21.0 + 58 * 6.0)


@pytest.mark.parametrize("fits", [True, False])
def test_partners_are_sought_only_where_cliques_of_rows_fit(monkeypatch, fits: bool) -> None:
    x = sp.variables(8)
    rows = [x[0] * x[i] == 0.5 * x[i + 1] for i in range(1, 7)]
    ball = sp.total([v**2 for v in x[1:]]) <= 1
    problem = sp.Problem(x[0], [*rows, ball], lower=-1.0, upper=1.0)
    families = Families(problem, (problem.objective,), True, "auto")
    monkeypatch.setattr(RelaxationSpec, "fits", lambda spec, cliques: fits)
    relaxation_specs(problem, families, (problem.objective,), None)
    assert ("partners" in families) is fits
