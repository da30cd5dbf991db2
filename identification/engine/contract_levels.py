"""Thresholds of all diagnoses (torques, poses, robots at rest): when a cause is listed, minor, or explains the gap."""

from __future__ import annotations

# probability: rivals below it are not listed.
LISTED = 0.05

# share: a finding is minor if it closes less than this share of the gap that remains after changes of the model within
# tolerance, and if the residual grows by less than `MINOR_FLOORS` without it.
MINOR_SHARE = 0.01

# noise floors: without a minor finding, the residual of no joint or frame grows by more than this.
MINOR_FLOORS = 0.5

# noise floors: the gap of a joint or frame counts as explained if its residual is at most this.
FLOORS_LEFT = 1.5

# share: it also counts as explained if the residual is below this share of the gap that remains after changes of the
# model within tolerance.
GAP_LEFT = 0.1
