"""Identification in a browser: a page on this machine, for ``setid serve``."""
