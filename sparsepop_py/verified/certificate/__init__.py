"""Certificates: claims about a problem, the arguments for them, and their verification."""
