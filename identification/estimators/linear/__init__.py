"""Functions that the linear estimators share: least squares, scatter, cautions."""
