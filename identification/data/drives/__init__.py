"""Torques of drives: from currents and voltages, with compensation undone, and with references that arrive late."""
