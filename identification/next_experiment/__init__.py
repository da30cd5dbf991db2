"""Designs the next recording (T-optimal): it separates effects that the existing recordings do not separate."""
