"""Multiple shooting: recordings simulated from many of their own states, with the given and the corrected model."""
