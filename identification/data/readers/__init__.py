"""Readers of recordings: one module for each file format."""
