"""The steps of a simulation, compiled."""
