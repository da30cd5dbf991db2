"""Charts as SVG, with fewer samples where there are many."""
