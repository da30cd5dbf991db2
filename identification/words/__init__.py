"""A diagnosis in words: effects, sizes, numbers, sentences."""
