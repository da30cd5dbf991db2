"""Written models and laws, loaded back and run over the recordings."""
