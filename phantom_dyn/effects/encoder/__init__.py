"""Effects of encoders: wrong zero, eccentric disc, coarse steps; one module for each effect."""
