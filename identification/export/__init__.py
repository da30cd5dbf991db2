"""Files from a diagnosis: models, ranges for training, and laws for control."""
