"""Draws charts as SVG, and thins long recordings for them."""
