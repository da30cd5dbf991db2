"""Checks for errors in a recording; each warning is one sentence that names the joint and the time."""
