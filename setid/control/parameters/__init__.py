"""The parameter sets of controllers and plants: sums of rows, cells, polytopes."""
