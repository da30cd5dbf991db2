"""Searches for the few columns, or groups of them, that explain a residual."""
