"""Fits on products of columns, block by block."""
