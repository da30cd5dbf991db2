"""Identification of a robot's parameters from recordings, and the report on it."""
