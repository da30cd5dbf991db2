"""Which few columns, beside bounded nuisances, explain a residual on blocks that no fit has seen; knows no robot."""
