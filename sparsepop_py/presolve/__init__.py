"""Finite boxes and scaling: what is done to a problem before it is relaxed."""
