"""Identification of a robot's parameters from recordings, and its report."""
