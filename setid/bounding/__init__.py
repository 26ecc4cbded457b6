"""Bound the parameters of one problem: by linear programs, by simulations, or by the engine."""
