"""Estimators of base parameters: one file each, all returning a `Fit`."""
