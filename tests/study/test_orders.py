"""Relaxation orders side by side."""

from __future__ import annotations

from pathlib import Path

import pytest

import sparsepop_py as sp
from sparsepop_py.study.orders import OrderComparison

LABORATORY = Path(__file__).resolve().parents[2] / "examples" / "problems" / "laboratory.gms"
MINIMUM = 52.7066065447  # one stationary point on the branch x1 > 7 of the hyperbola


@pytest.fixture(scope="module")
def compared() -> OrderComparison:
    return sp.compare_orders(sp.read(LABORATORY), [1, 2, 3])


def test_the_plain_rows_are_those_of_the_original(compared: OrderComparison) -> None:
    """Order 1 without bounds is 28.5556, and no higher order proves less."""
    plain = [row for row in compared.rows if row.effort == "plain"]
    assert [row.order for row in plain] == [1, 2, 3]
    for row in plain[:2]:
        param = {"relaxOrder": row.order, "tighten": 0, "printLevel": 0, "localSearch": 1}
        given = sp.sparsePOP(sp.read(LABORATORY), param)
        assert given.SDPobjValue == pytest.approx(row.proved, abs=1e-6)
        assert given.POP.solverValue == pytest.approx(row.solver_value, rel=1e-6)
        assert 28.5555 < row.proved <= MINIMUM
    assert plain[0].solver_status == "solved"
    assert [max(row.block_sizes) for row in plain] == [3, 4, 8]


def test_presolve_closes_the_gap_from_order_two_on(compared: OrderComparison) -> None:
    rows = [row for row in compared.rows if row.effort == "presolve"]
    assert [str(row.result.status) for row in rows] == ["BOUNDED", "OPTIMAL", "OPTIMAL"]
    for row in rows[1:]:
        assert row.proved == pytest.approx(MINIMUM, abs=1e-4) and row.proved <= MINIMUM
        assert row.result.certificate is not None
        assert row.result.certificate.verify(row.result.problem).ok
    assert compared.proved <= MINIMUM <= compared.attained


def test_the_table_has_a_line_for_each_row_and_its_remarks(compared: OrderComparison) -> None:
    lines = compared.table().splitlines()
    assert [line.split()[:2] for line in lines[2:8]] == [
        [order, effort] for order in "123" for effort in ("plain", "presolve")
    ]
    assert lines[8].startswith("together: 52.7066")
    assert any("A solver's value is no bound" in line for line in lines[9:])


def test_a_maximum_is_compared_in_its_own_sense() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(-(x - y), [x**2 + y**2 <= 1], lower=-1, upper=1, sense="max")
    compared = sp.compare_orders(problem, [1], cliques=("sparse", "dense"))
    assert [(row.effort, row.cliques) for row in compared.rows] == [
        ("plain", "sparse"), ("plain", "dense"), ("presolve", "sparse"), ("presolve", "dense"),
    ]  # fmt: skip
    for row in compared.rows:
        assert row.attained <= 2**0.5 <= row.proved
        assert row.proved == pytest.approx(2**0.5, abs=1e-5)
    assert "<= maximum <=" in compared.table()


def test_no_order_is_tried_below_where_the_objective_falls_without_limit() -> None:
    (x,) = sp.variables(1)
    result = sp.solve(sp.Problem(x**3, upper=1), sp.Options(order=3, effort="plain"))
    assert result.status is sp.Status.UNBOUNDED


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"orders": []}, "orders: found"),
        ({"orders": [0]}, "Options.order: found 0"),
        ({"efforts": ["auto"]}, "efforts: found 'auto', expected 'plain' or 'presolve'"),
        ({"cliques": "dense"}, "cliques: found str, expected a list"),
    ],
)
def test_wrong_arguments(given: dict[str, object], message: str) -> None:
    with pytest.raises(sp.ProblemError, match=message):
        sp.compare_orders(sp.read(LABORATORY), **given)  # type: ignore[arg-type]
