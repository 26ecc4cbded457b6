"""A second checker of proofs: standard library only, exact numbers, nothing of what it checks.

``python checker/check.py problem.json certificate.json`` is the program; the format that it
reads is described in ``docs/certificate_format.md``.
"""
