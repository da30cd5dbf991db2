"""Friction: one law a file."""
