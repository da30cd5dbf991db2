"""The catalogue of effects, with one module for each effect."""
