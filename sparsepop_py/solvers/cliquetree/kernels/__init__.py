"""Dense linear algebra on stacks of small matrices, in numpy and compiled."""
