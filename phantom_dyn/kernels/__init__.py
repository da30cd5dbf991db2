"""Loops over samples or time steps that are compiled where numba is installed, and the same Python where it is not."""
