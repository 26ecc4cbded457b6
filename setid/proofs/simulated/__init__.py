"""Cells of parameters that a simulation of the whole structure narrows or excludes."""
