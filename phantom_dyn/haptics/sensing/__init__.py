"""Encoders, velocity estimators, and simulation of sampled loops over time."""
