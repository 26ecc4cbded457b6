"""Measurements of sparsepop_py, alone and beside its peers.

``python -m benchmarks list`` names the families of problems, ``run`` measures them and
writes JSON lines, ``report`` makes tables and pictures of these lines, ``orders`` compares
relaxation orders on files of your own. All times are CPU seconds of one process a case.
"""
