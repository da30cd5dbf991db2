"""Estimates among what is physically possible."""
