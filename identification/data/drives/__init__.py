"""Drives: torque of currents and voltages, shares of a supply, loops that a log shows, references that arrive late."""
