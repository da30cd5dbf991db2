"""Output of a running command, and its interruption by the user."""
