"""Drives: torque from currents and voltages, position loops that a log shows, and when references reach the drive."""
