"""Experiments that identify a device: relay and white noise."""
