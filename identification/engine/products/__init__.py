"""Computes products of columns and residual, summed over each block of samples; fits use these, not the samples."""
