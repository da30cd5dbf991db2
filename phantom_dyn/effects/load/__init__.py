"""Bodies, loads and gravity; one module for each effect."""
