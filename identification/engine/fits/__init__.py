"""Fits of sets of columns beside bounded nuisances, and what further columns gain beside them."""
