"""Findings: which of the chosen effects pass all gates, each with its numbers, share of the gap and probability."""
