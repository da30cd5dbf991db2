"""Minima within bounds, minima of problems that differ a little, spans of columns, and work in two threads."""
