"""What is wrong with torques by themselves: clipping."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.recordings import Recording

Array = np.ndarray

# From this share of the samples, or this many in a row, at the extreme value on.
_CLIPPED_SHARE, _CLIPPED_RUN = 0.01, 5
# A smooth peak, however coarsely rounded, has at most 2.4 times as many samples in its top level as in the next.
_TOP_HEAVY = 4


def _clipped(tau: Float[Array, " N"]) -> tuple[float, float, int] | None:
    """Extreme value, share of samples at it and longest run, if the upper end of ``tau`` is clipped."""
    extent = np.ptp(tau)
    top = float(np.max(tau))
    levels = np.unique(tau[tau > top - 0.1 * extent])
    # Levels closer than the numbers' own rounding are one.
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * extent])] if len(levels) else levels
    step = max(float(top - levels[-2]) if len(levels) > 1 and len(levels) < 50 else 0.0, 2e-3 * extent)
    at_top = tau >= top - 1e-9 * max(extent, abs(top))
    below = (tau < top) & ~at_top & (tau >= top - 1.5 * step)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_top, [False]])))
    run = int(np.max(edges[1::2] - edges[::2]))
    share = float(np.mean(at_top))
    if (share >= _CLIPPED_SHARE or run >= _CLIPPED_RUN) and at_top.sum() >= _TOP_HEAVY * max(int(below.sum()), 1):
        return top, share, run
    return None


def check_clipping(recording: Recording) -> tuple[str, ...]:
    """Torques that sit at their extreme value."""
    if recording.tau is None:
        return ()
    out = []
    for j, joint in enumerate(recording.joint_names):
        tau = recording.tau[:, j]
        if np.ptp(tau) == 0:
            if tau[0] != 0:
                out.append(f"{recording.file}: the torque of {joint} is {tau[0]:.6g} throughout: was it recorded?")
            continue
        for sign in (1.0, -1.0):
            found = _clipped(sign * tau)
            if found is not None:
                value, share, run = found
                out.append(
                    f"{recording.file}: the torque of {joint} sits at {sign * value:.6g} for {100 * share:.2g} % of "
                    f"the samples, up to {run} in a row: it is clipped there."
                )
    return tuple(out)
