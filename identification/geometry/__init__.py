"""Kinematic calibration from measured poses of frames: joint zeros, places of joints, and elasticity of joints."""
