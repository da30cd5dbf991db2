"""Effects of bodies, loads and gravity; one module for each effect."""
