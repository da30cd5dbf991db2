"""Effects that a user brings: where they are read from, and their trial on a robot."""
