"""Devices with their published constants and closed forms."""
