"""Simulate a robot that differs from its model and whose drives follow a controller."""
