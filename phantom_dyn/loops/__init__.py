"""Closed chains: what the passive joints of a tree do when the active ones move."""
