"""Searches for the few columns that explain a residual on held-out data, next to nuisances; knows no robot."""
