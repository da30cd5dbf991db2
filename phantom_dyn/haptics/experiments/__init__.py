"""Experiments that identify a device: relay, white noise, swept sine, and a fit of the two-mass model to a response."""
