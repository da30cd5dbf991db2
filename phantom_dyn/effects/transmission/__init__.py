"""Transmissions and springs between motor, link and base; one module for each effect."""
