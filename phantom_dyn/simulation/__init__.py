"""Simulation of a robot that differs from its model, moved by its drives under a controller."""
