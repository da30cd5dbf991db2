"""Simulation of a cheap haptic device on a good one: inertia, play, friction, cogging and a weaker motor."""
