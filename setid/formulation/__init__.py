"""From a record, a structure, noise and priors to a polynomial problem with named unknowns."""
