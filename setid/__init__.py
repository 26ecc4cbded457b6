"""Guaranteed parameter intervals from measured data with bounded noise.

``setid`` translates identification problems (equation error, output error,
errors-in-variables, block structures, continuous time) into polynomial
optimization problems, whose proved bounds become parameter uncertainty
intervals. It rests on the public names of :mod:`sparsepop_py` alone. The
translation is not part of this release; the package holds its place.
"""
