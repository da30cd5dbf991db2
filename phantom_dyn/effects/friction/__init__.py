"""Friction; one module for each law."""
