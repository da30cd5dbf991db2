"""Closed chains: motion of the passive joints that follows from the active joints and the loops."""
