"""Which set of effects explains the recordings, and what else may."""
