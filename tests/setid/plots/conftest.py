"""For the tests of pictures: a result that they draw, and figures closed after each."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib.pyplot as plt
import pytest
from identified_cases import second_order

import setid


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return second_order(samples=60)
