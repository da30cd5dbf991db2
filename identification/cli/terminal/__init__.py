"""Output of a command while it runs, and how it is interrupted."""
