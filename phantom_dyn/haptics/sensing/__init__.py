"""Encoders, velocity estimators, and sampled loops in time."""
