"""Families of problems, and how their cases are made."""
