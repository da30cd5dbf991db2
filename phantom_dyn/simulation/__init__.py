"""A robot that differs from its model, moved by its drives."""
