"""What users do with a diagnosis: training in simulation, and control."""
