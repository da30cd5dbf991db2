"""phantom_dyn: robots, effects and dynamics; it knows nothing of recordings or fitting."""

__version__ = "0.1.0"
