"""Moment relaxations: bases, blocks, shapes, sparsity of terms, and the way back from duals."""
