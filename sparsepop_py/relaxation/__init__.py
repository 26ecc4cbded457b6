"""Moment relaxations: bases, blocks, shapes, term sparsity, and multipliers from duals."""
