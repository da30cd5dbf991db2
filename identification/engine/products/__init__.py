"""Computes products of columns and residual by block of samples; all fits use these products, not the samples."""
