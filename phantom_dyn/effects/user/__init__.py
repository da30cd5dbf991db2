"""Effects that a user brings: the base class for a law alone, where they are read from, and their trial on a robot."""
