"""Motions that excite a robot's parameters."""
