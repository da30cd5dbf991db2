"""Conclusions from a fit: the gap, the findings with their intervals, bounds on other effects, and the verdict."""
