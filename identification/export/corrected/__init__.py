"""Builds the corrected model (given robot plus findings) and its URDF, MJCF and YAML files."""
