"""Where a cone of denominators is split."""

from __future__ import annotations

import numpy as np
import pytest

from setid.minimum_noise.cones.edges import changing_edge

FILTERED, ONES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.2, 0.8]]), np.ones(3)


def test_without_a_dual_solution_the_longest_edge_is_split_in_the_middle() -> None:
    """Distances by hand: 2 from the first vector to each other one, 1.6 between these."""
    assert changing_edge(FILTERED, ONES, ONES) == (0, 1, (1, 1))


def test_vectors_of_other_sizes_are_weighted_to_the_same_size() -> None:
    sizes = np.array([4.0, 1.0, 1.0])
    assert changing_edge(FILTERED * sizes[:, None], sizes, ONES) == (0, 1, (1, 4))


@pytest.mark.parametrize(
    ("shares", "weights"),
    [((1, 1), (1, 1)), ((2, 1), (1, 1)), ((8, 1), (4, 1)), ((1, 8), (1, 4)), ((1, 4096), (1, 64))],
)
def test_a_new_vector_lies_towards_the_larger_share(
    shares: tuple[int, int], weights: tuple[int, int]
) -> None:
    """Half of the quotient of the shares counts, up to 64."""
    t = np.array([*shares, 0.0]) / sum(shares)
    assert changing_edge(FILTERED, ONES, ONES, np.outer(t, t)) == (0, 1, weights)


def test_the_edge_is_between_vectors_with_shares() -> None:
    t = np.array([0.0, 0.5, 0.5])
    assert changing_edge(FILTERED, ONES, ONES, np.outer(t, t)) == (1, 2, (1, 1))


def test_equal_vectors_have_no_edge() -> None:
    assert changing_edge(np.ones((3, 3)), ONES, ONES) is None
