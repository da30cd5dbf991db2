"""Scores diagnoses of the gap between a robot and its model: what is missing, at which joint and how large.

Installed it is ``gapbench``, in this checkout ``benchmarks.gapbench``: modules import each other by relative names, and
nothing of the library that this repository is about.
"""

__version__ = "0.1.0"
