"""Cells of parameters that a simulation of the whole structure tightens or excludes."""
