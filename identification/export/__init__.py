"""Writes files from a diagnosis: corrected models, ranges for training, and laws for control."""
