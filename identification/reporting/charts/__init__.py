"""Draws charts as SVG, and reduces long recordings to fewer samples for the charts."""
