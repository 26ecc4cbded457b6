"""Identifications: rows, boxes of the parameters, intervals."""
