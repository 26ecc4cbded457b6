"""Relaxation of SparsePOP 3.03, switch by switch."""
