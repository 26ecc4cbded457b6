"""Network structures: weights, evaluation, simulation in floating point."""
