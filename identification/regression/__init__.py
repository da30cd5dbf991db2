"""The linear equations of a robot, its logs and effects, and their base parameters."""
