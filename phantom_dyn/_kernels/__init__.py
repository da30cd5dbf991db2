"""Compiled loops over samples: rigid bodies, closed chains, filters. The same Python where numba is not installed."""
