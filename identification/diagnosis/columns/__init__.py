"""What may explain a residual: candidate terms and their columns."""
