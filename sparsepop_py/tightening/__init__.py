"""Bound tightening: McCormick relaxations, OBBT by linear and by semidefinite programs."""
