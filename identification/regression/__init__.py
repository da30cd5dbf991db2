"""Robot, logs and effects as linear equations, and their base parameters."""
