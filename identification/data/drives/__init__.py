"""Drives with loops of their own: shares of a supply, loops that a log shows, references that arrive late."""
