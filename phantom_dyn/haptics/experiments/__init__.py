"""Experiments that identify a device: relay, white noise, and the two-mass model that fits a response."""
