"""Robots that are not bolted down: what their base's sensors read, and when nothing touches what a joint carries."""
