"""Writes a robot as URDF and MJCF, loads the files again, and compares their torques with the robot's."""
