"""The `Robot`, and how it is loaded from URDF, MJCF and robot.yaml."""
