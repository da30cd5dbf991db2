"""Encoders: one effect a file."""
