"""Cones of denominators of which multipliers of the rows leave no member, or bound what is left."""
