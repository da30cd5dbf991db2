"""Checks the written models and laws: each is loaded again and evaluated on the recordings."""
