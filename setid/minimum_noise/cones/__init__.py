"""Cones of denominators: their linear programs, and the search that splits them."""
