"""Exact polynomials, and intervals in fixed point."""
