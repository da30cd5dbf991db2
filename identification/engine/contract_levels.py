"""Thresholds of the contract for torques, poses and rests alike: when a cause is listed, minor, or explains the gap."""

from __future__ import annotations

# probability: least of a listed rival.
LISTED = 0.05

# share: of the gap after moves within tolerance. A finding that closes less is minor, if the next limit holds as well.
MINOR_SHARE = 0.01

# noise floors: largest growth of the residual of any joint or frame without a minor finding.
MINOR_FLOORS = 0.5

# noise floors: largest residual of a joint or frame whose gap counts as explained.
FLOORS_LEFT = 1.5

# share: of the gap of a joint or frame after moves within tolerance. A residual below it counts as explained, too.
GAP_LEFT = 0.1
