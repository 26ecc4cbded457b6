"""Search for good feasible points in floating point. Nothing here is proved."""
