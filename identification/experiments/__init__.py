"""Experiments on a device that part what one recording cannot: friction tests, blocked-arm loops, identification."""
