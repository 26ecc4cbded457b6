"""Branch and bound: the tree and the processing of one node."""
