"""For all tests: pictures are drawn without a display."""

import matplotlib
from hypothesis import Phase, settings

matplotlib.use("Agg")

# Deliberate faults (tests/mutants): the same examples each time, and the first failure is enough.
settings.register_profile(
    "mutants", derandomize=True, database=None, phases=(Phase.explicit, Phase.generate)
)
