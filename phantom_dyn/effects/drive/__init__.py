"""What a drive does to its command: one effect a file."""
