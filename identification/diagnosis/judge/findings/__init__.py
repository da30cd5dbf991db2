"""Findings: each effect with its numbers, its share of the gap and its probability."""
