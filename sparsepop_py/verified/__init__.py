"""The trusted kernel: everything that a claim about a problem rests on.

It imports ``algebra``, ``problem`` and ``errors`` and nothing else of the package: no solver, no
linear program, no relaxation. ``README.md`` beside this file says what is trusted and assumed.
"""
