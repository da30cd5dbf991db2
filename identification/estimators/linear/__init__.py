"""Functions that linear estimators share: least squares, covariances, warnings."""
