"""Verified arithmetic: every rounding error is accounted for."""
