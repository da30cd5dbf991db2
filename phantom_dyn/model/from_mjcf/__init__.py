"""Reading of MJCF: tree, drives, following joints and loops of a robot."""
