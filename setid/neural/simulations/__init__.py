"""Verified simulation, and the least output noise over the initial state."""
