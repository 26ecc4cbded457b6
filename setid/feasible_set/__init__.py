"""All parameter vectors that are consistent with a record: boxes, supports, projections."""
