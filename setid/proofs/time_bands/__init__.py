"""Proved ranges of outputs over time, by cells of the denominator's parameters."""
