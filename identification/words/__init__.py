"""Texts of a diagnosis: words for effects, sizes and numbers, and the sentences that contain them."""
