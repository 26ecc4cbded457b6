"""Conic programs and their solutions, as solvers see them."""
