"""Encoders; one module for each effect."""
