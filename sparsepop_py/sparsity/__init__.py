"""Correlative sparsity: chordal extensions and cliques with the running intersection property."""
