"""A recording simulated again from many of its own states: what the gap means for motion, before and after."""
