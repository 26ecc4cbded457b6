"""Analyse the pattern of a program once: elimination tree, fronts, places of entries."""
