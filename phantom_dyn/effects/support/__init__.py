"""Functions that several effects share: rows of joints, displaced joints, changed robots, periodograms."""
