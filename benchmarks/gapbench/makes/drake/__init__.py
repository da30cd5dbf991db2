"""A second make of sealed cases, on Drake: robots, friction, drives, effects and sizes written for it alone.

It imports neither the two packages of the project, nor Pinocchio, nor the first generator. Drake is no dependency of
the project: `engine.py` says where it is looked for.
"""
