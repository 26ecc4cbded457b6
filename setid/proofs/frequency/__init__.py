"""Proved regions of frequency responses, at frequencies and on arcs of the unit circle."""
