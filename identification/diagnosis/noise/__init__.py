"""Noise of a residual, and what chance and encoders feign."""
