"""Orders of regressor networks are whole numbers of any kind, numpy's too."""

from __future__ import annotations

import numpy as np
import pytest

import setid
from setid import neural


def test_orders_of_numpy_are_taken() -> None:
    net = neural.Network([[[0.5, 1.0, 0.0]]], [[0.0]])
    made = neural.NNARX(net, order=np.int64(1), channels=np.int64(1))
    assert type(made.order) is int and type(made.channels) is int
    for wrong in (0, True, 1.5, "1"):
        with pytest.raises(setid.ModelError, match="order"):
            neural.NNARX(net, order=wrong)
