"""Torques of drives: computed from currents and voltages, and corrected for compensation and delayed references."""
