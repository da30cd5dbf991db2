"""Stability limits of a sampled device: virtual walls, dampers, force feedback and teleoperation."""
