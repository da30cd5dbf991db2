"""Checks of recorded torques: filter, lag, unit, sign, and weight or friction that a controller subtracted."""
