"""Thresholds of all diagnoses (torques, poses, robots at rest): when a cause is listed, minor, or explains the gap."""

from __future__ import annotations

# Probability below which a rival is not listed.
LISTED = 0.05

DOUBTED = 0.5
"""Largest probability of a finding if something that the comparison of effects assumes may be false: the torque may be
that of a model, the robot's file states forces that the model leaves out, or the model fits another recording."""

# A finding is minor if both hold:
# - it closes less than this share of the gap (the gap after changes of the model within tolerance), and
MINOR_SHARE = 0.01
# - without the finding the residual of every joint or frame grows by less than this many noise floors.
MINOR_FLOORS = 0.5

# The gap of a joint or frame counts as explained if its residual is at most this many noise floors,
FLOORS_LEFT = 1.5
# or less than this share of the gap (the gap after changes of the model within tolerance).
GAP_LEFT = 0.1
