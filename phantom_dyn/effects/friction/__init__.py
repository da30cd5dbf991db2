"""Effects of friction; one module for each law."""
