"""Check of the written models and laws: each is loaded back and run over the recordings."""
