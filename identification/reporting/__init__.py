"""Presents a diagnosis in figures, tables and files."""
