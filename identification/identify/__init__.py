"""Identifies a robot's parameters from recordings, and writes a report and model files."""
