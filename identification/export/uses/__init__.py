"""Writes files that use a diagnosis for training in simulation and for control."""
