"""What a diagnosis gives back: corrected models in files."""
