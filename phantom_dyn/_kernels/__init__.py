"""Loops over samples that numba compiles: rigid bodies, closed chains, filters."""
