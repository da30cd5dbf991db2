"""Diagnoses many recordings separately, and compares the robots of a fleet."""
