"""Polynomials as exact data: monomials, polynomials, stacked systems, matrices of polynomials."""
