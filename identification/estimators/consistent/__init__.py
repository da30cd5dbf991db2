"""Estimates of physically consistent parameters."""
