"""Transmissions and springs between motor, link and base: one effect a file."""
