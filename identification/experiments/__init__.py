"""Special experiments for parameters that an ordinary recording cannot separate, after the CEA paper (Janot, 2007)."""
