"""Backlash and compliance of joints from slow recordings of positions and references, at rest under known loads."""
