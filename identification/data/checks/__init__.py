"""Checks for errors in a recording: one sentence each, with joint and place."""
