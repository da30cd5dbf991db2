"""Diagnoses of many recordings, each by itself, and comparisons of the robots of a fleet."""
