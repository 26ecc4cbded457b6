"""Certificates of stability: arcs of the unit circle, small gain, zero exclusion, refutation."""
