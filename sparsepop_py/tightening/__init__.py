"""Tighten the bounds of variables: McCormick relaxations, OBBT by linear and semidefinite programs."""
