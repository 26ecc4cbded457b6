"""Local fits of simulations to a record, from which searches begin."""
