"""What a diagnosis gives back: models in files, ranges for training, laws for control."""
