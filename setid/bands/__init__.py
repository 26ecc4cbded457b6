"""Ranges of responses, outputs and internal signals over the feasible parameter set."""
