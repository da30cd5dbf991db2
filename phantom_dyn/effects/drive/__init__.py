"""What a drive does to its command; one module for each effect."""
