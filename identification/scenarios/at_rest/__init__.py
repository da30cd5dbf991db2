"""Diagnosis of backlash and compliance from positions and references while the robot rests under known loads."""
