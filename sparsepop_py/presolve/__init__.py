"""Presolve: a first box, and relaxations that fit. Hints only: every step is replayed."""
