"""Boxes of parameters from rows with bounded uncertainty: the records and their checks."""
