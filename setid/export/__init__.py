"""Identified systems for other software, and in continuous time."""
