"""Measurements of sparsepop_py: ``python -m benchmarks growth`` and ``... certificates``.

CPU seconds of this process, one thread where the libraries allow it. Tables are printed
as Markdown.
"""
