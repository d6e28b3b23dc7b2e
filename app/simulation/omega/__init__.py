"""Omega, the set of postures over which the constants of Theorem 1 are computed, and the search in it."""
