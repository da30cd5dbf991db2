"""Thresholds of the contract that torques, poses and rests have in common: what is listed, minor and explained."""

from __future__ import annotations

# probability: from which on a rival is listed.
LISTED = 0.05

# share: of the gap within tolerance, below which a finding may be too small to matter.
MINOR_SHARE = 0.01

# noise floors: by which the residual of every joint or frame grows at most without such a finding.
MINOR_FLOORS = 0.5

# noise floors: that a joint or frame may have left where the gap counts as explained.
FLOORS_LEFT = 1.5

# share: of the own gap within tolerance of a joint or frame, that may be left as well.
GAP_LEFT = 0.1
