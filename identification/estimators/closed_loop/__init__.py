"""Estimators that simulate the closed loop."""
