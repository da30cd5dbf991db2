"""Prints the output and progress of a command, and handles interruptions by the user."""
