"""The set of all parameter vectors that are consistent with a record: boxes, supports, projections."""
