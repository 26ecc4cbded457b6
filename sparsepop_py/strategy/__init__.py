"""The outer loops: orders, adaptive choice of relaxations, many objectives over one set."""
