"""Slow recordings of positions and references: how far a joint gives way under loads of either sign, at rest."""
