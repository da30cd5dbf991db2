"""Small numerical tools: bounded least squares, two threads."""
