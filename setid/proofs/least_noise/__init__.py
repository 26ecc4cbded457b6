"""Proved lower bounds of the noise or error that explains a record."""
