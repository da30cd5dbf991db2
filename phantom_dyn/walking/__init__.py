"""Biped walking: zero moment point, support polygon, a walking reference, and a haptic signal of the margin."""
