"""A diagnosis in figures, tables and files."""
