"""Proofs that points exist: feasible points and rays along which the objective falls."""
