"""Designs motions that excite a robot's parameters."""
