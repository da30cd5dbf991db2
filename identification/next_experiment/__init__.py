"""T-optimal design of the next recording, which is to separate effects that the existing recordings do not."""
