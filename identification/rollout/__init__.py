"""Multiple shooting: simulations of the given and the corrected model from many states of the recordings."""
