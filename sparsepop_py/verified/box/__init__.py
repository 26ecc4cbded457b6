"""Boxes that contain the feasible set: propagation (FBBT), scaling, left inverses."""
