"""Rows of the pages in docs/papers, one module for each part of a paper; `paper_pages.py` writes them."""
