"""Uses of a diagnosis: training in simulation, and control."""
