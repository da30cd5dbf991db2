"""T-optimal design of the next recording, so that it separates effects that one recording cannot."""
