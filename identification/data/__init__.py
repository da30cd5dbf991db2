"""Recordings: files in many formats to signals that a fit can use."""
