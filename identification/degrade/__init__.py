"""Adds effects to a log, as if it were recorded on a cheaper device."""
