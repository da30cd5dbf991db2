"""A good haptic device made to feel like a cheaper one: inertia, play, friction, cogging and a weaker motor."""
