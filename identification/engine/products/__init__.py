"""Products of columns and residual by block, which all fits work on."""
