"""Compiled steps of a simulation."""
