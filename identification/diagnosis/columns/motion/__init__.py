"""Limits of what a recorded motion shows: standstill, motion in one sine, and MuJoCo's soft friction."""
