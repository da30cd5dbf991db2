"""Readers: one format of recordings a file."""
