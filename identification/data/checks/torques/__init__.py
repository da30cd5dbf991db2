"""Checks of recorded torques: their filters, lag, scale, and what was taken off them."""
