"""A robot as data, and how it is loaded from URDF, MJCF and robot.yaml."""
