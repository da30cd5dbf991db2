"""The corrected model as URDF, MJCF and YAML."""
