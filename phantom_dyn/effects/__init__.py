"""Effects: named causes of a gap between robot and model, one module for each, and the catalogue of all of them."""
