"""Charts as SVG: drawn directly or by matplotlib, with fewer samples where there are many."""
