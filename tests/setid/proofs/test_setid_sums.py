"""Sums of products as coordinates of a cover: replays in rationals."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from setid.feasible_set.proposer import Proposer
from setid.formulation.lifting import Sum
from setid.proofs.supports import Cover, supports
from setid.proofs.time_bands.sums import with_sums

NAMES = ("a", "b", "c")
SUMS: tuple[Sum, ...] = (
    ((1.0, ("a",)), (1.0, ("b",))),
    ((1.0, ("a", "b")),),
    ((-3.0, ("a", "b")), (0.1, ("b", "c")), (1.0, ("c",))),
    ((0.5, ("s2", "c")),),
    ((2.0, ("a", "a")),),
    ((0.1, ()), (-0.3, ("a",)), (1.0, ("a", "c"))),
)
LIFTED = ("s1", "s2", "s3", "s4", "s5", "s6")
BOXES = [
    ([-1.0, 0.5, -2.0], [2.0, 0.75, -1.0]),
    ([1e6, -3e-7, 0.1], [1.1e6, 2e-7, 0.1]),
    ([0.1, 0.1, 0.1], [0.1, 0.1, 0.1]),
    ([-0.3, -0.7, 0.0], [0.0, -0.1, 1.0 / 3.0]),
]


def exact(theta: np.ndarray) -> list[Fraction]:
    """All coordinates of a point, in rationals."""
    found = {name: Fraction(value) for name, value in zip(NAMES, theta.tolist(), strict=True)}
    for name, own in zip(LIFTED, SUMS, strict=True):
        total = Fraction(0)
        for coefficient, word in own:
            product = Fraction(coefficient)
            for factor in word:
                product *= found[factor]
            total += product
        found[name] = total
    return list(found.values())


def points(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, -1).T
    return np.concatenate([corners, rng.uniform(lower, upper, (40, 3))])


def covers(ends: tuple[list[float], list[float]]) -> tuple[Cover, Cover, np.ndarray]:
    lower, upper = (np.array(x) for x in ends)
    matrix, right = np.array([[1.0, -1.0, 0.5]]), np.array([1e7])
    plain = Cover(NAMES, lower, upper, matrix, right, True)
    return plain, with_sums(plain, LIFTED, SUMS), points(lower, upper)


@pytest.mark.parametrize("ends", BOXES)
def test_all_points_of_the_box_are_covered(ends: tuple[list[float], list[float]]) -> None:
    plain, cover, inside = covers(ends)
    assert cover.names == (*NAMES, *LIFTED) and not cover.exact
    assert np.array_equal(cover.matrix[0], [1.0, -1.0, 0.5, 0, 0, 0, 0, 0, 0])
    assert cover.right[0] == plain.right[0]
    for theta in inside:
        values = exact(theta)
        for value, low, high in zip(
            values, cover.lower.tolist(), cover.upper.tolist(), strict=True
        ):
            assert Fraction(low) <= value <= Fraction(high)
        for row, right in zip(cover.matrix.tolist(), cover.right.tolist(), strict=True):
            total = sum(Fraction(c) * v for c, v in zip(row, values, strict=True))
            assert total <= Fraction(right)


@pytest.mark.parametrize("ends", BOXES[:1] + BOXES[3:])
def test_rows_are_the_hull_of_a_product(ends: tuple[list[float], list[float]]) -> None:
    """Over its four tangents a product of two parameters has its exact range on each edge."""
    plain, cover, _ = covers(ends)
    for place in (0, 1):  # fix one factor at an end: then the product is linear
        for side in (plain.lower, plain.upper):
            lower, upper = cover.lower.copy(), cover.upper.copy()
            lower[place] = upper[place] = side[place]
            edge = Cover(cover.names, lower, upper, cover.matrix, cover.right, False)
            found = supports(edge, np.eye(9)[[4]], Proposer)[0]
            other = np.array([plain.lower[1 - place], plain.upper[1 - place]]) * side[place]
            assert found == pytest.approx([other.min(), other.max()], abs=1e-9)


def test_sums_without_products_are_linear_equations() -> None:
    _, cover, _ = covers(BOXES[0])
    ranges = supports(cover, np.array([[1.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]), Proposer)
    assert np.abs(ranges).max() < 1e-12
