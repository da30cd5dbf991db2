"""Numerics: minima within bounds, minima of slightly changed problems, spans of columns, work in two threads."""
