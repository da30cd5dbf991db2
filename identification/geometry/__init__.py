"""Kinematic calibration from measured poses of frames: joint zeros, joint placements and joint elasticities."""
