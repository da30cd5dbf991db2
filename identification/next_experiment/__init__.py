"""T-optimal design of the next recording, which separates effects that one recording cannot."""
