"""What a command shows while it runs and how it is interrupted; completion of its words in a shell."""
