"""The report: one HTML page of a diagnosis, section by section."""
