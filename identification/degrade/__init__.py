"""The log that a cheaper device would have given."""
