"""Estimators that simulate the robot under its position controllers (closed loop)."""
