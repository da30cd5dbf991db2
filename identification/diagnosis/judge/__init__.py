"""What is claimed of a fit: gap, findings, bounds, verdict."""
