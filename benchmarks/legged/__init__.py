"""Cases of robots on moving bases, to measure how often their joints are diagnosed right."""
