"""Estimators of base parameters: one file for each, and each returns a `Fit`."""
