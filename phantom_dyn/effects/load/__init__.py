"""Bodies, loads and gravity: one effect a file."""
