"""Writes the files of a diagnosis together, and reads a diagnosis from its file."""
