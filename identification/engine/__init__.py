"""Search for the few columns that explain a residual on held-out blocks beside bounded nuisances; knows no robot."""
