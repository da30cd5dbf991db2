"""Robots that are not bolted down: readings of the sensors on the base, and when limbs are free of contact."""
