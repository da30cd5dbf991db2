"""What is wrong with the times of a recording: jitter and gaps."""

from __future__ import annotations

import numpy as np

from identification.checks.smooth import included
from identification.recordings import Recording

# A step that differs from the median by more than this share is irregular; timers of a real-time system keep 1 %.
_JITTER = 0.1
# Share of irregular steps that is worth a warning.
_IRREGULAR_SHARE = 0.01
# A step longer than this many medians is a gap: samples are missing.
_GAP = 2.5


def check_timing(recording: Recording) -> tuple[str, ...]:
    """Sentences about irregular sampling and missing samples."""
    kept = included(recording)
    steps = np.diff(recording.t)[kept[1:] & kept[:-1]]
    starts = recording.t[:-1][kept[1:] & kept[:-1]]
    if not len(steps):
        return ()
    step = float(np.median(steps))
    gap = steps > _GAP * step
    out = []
    irregular = np.abs(steps - step) > _JITTER * step
    share = float(np.mean(irregular & ~gap))
    if share > _IRREGULAR_SHARE:
        low, high = np.percentile(steps[~gap], [1, 99])
        out.append(
            f"{recording.file}: sampling is irregular: {100 * share:.0f} % of the steps differ from the median of "
            f"{1e3 * step:.3g} ms by more than {100 * _JITTER:.0f} % (1st to 99th percentile {1e3 * low:.3g} to "
            f"{1e3 * high:.3g} ms)."
        )
    if gap.any():
        worst = int(np.argmax(steps))
        noun = "gap" if gap.sum() == 1 else "gaps"
        out.append(
            f"{recording.file}: {int(gap.sum())} {noun} in time; the longest lasts {1e3 * steps[worst]:.3g} ms at "
            f"t = {starts[worst]:.6g} s, where a step is {1e3 * step:.3g} ms."
        )
    return tuple(out)
