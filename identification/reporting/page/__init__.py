"""Writes the report: one HTML page on a diagnosis, with one module per section."""
