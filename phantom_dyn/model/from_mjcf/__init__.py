"""A robot read from MJCF: its tree, drives, followers and loops."""
