"""Multiple shooting: simulates given and corrected model from many recorded states, and compares the motions."""
