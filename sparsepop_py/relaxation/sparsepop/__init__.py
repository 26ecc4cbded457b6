"""The relaxation of SparsePOP 3.03, switch by switch."""
