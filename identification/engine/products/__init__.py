"""Computes products of columns and residual by block; all fits use these products."""
