"""Noise of a residual, and spurious effects from chance and encoder noise."""
