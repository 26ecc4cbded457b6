"""Linear programs: HiGHS in floating point, and an exact simplex method in integers."""
