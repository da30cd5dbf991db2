"""Texts of a diagnosis: words for effects, sizes and numbers, and sentences made of them."""
