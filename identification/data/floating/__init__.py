"""Recordings of robots with a floating base: sensors on the base, and times at which limbs are free of contact."""
