"""Cells of parameters: enclosures of all simulations in a cell, and proofs that cells are empty."""
