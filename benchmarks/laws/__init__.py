"""Laws that are met on real robots and are no effect of the catalogue: cases with known answers."""
