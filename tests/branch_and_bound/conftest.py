"""For tests of branch and bound."""

import pytest
from loop_cases import ALL_SPECS


@pytest.fixture
def only_branch(monkeypatch):
    """Leave only the linear relaxation and branch and bound."""
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
