"""A robot as URDF and MJCF, loaded again and compared."""
