"""How far simulated motion strays from the recorded one, and over which horizon that says something."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Array = np.ndarray

HORIZONS = (0.5, 0.35, 0.25, 0.15, 0.1, 0.06, 0.04)  # [s], the longest first
# The noise of the start may leave this share of what the given model misses, or of how far the joints move.
_OF_ERROR, _OF_TRAVEL = 0.33, 0.05


@dataclass(frozen=True)
class Errors:
    """Simulated less recorded positions of windows, each ``(n, nv)``.

    Attributes:
        t: Times since the start of each window [s].
        before: Of the given model.
        after: Of the corrected model.
        noise: What the noise of its start changes of the corrected model's motion.
        travel: Recorded positions less that at the start.
    """

    t: tuple[Float[Array, " _"], ...]
    before: tuple[Float[Array, "_ nv"], ...]
    after: tuple[Float[Array, "_ nv"], ...]
    noise: tuple[Float[Array, "_ nv"], ...]
    travel: tuple[Float[Array, "_ nv"], ...]

    def of(self, windows: list[int]) -> Errors:
        """Of some of the windows."""
        series = (self.t, self.before, self.after, self.noise, self.travel)
        return Errors(*(tuple(one[k] for k in windows) for one in series))

    def rms(self, series: tuple[Float[Array, "_ nv"], ...], horizon: float) -> Float[Array, " nv"]:
        """Root mean square over all windows from behind the start up to a time."""
        kept = [x[1:][t[1:] <= horizon + 1e-9] for t, x in zip(self.t, series, strict=True)]
        return np.sqrt(np.mean(np.concatenate(kept) ** 2, axis=0))


def possible_horizons(errors: Errors, horizons: tuple[float, ...]) -> tuple[float, ...]:
    """Those that the windows are long enough for and that have two samples; else the windows' own length."""
    long = max(float(t[-1]) for t in errors.t)
    step = max(float(t[1]) for t in errors.t)
    return tuple(h for h in horizons if 2 * step <= h <= long + 0.5 * step) or (long,)


def horizon_of(errors: Errors, horizons: tuple[float, ...] = HORIZONS) -> float:
    """The longest horizon over which the noise of the start stays small on every joint; else the shortest.

    Args:
        errors: Over the longest.
        horizons: To choose from, the longest first; those with fewer than two samples are left out.
    """
    possible = possible_horizons(errors, horizons)
    for horizon in possible:
        allowed = np.maximum(
            _OF_ERROR * errors.rms(errors.before, horizon), _OF_TRAVEL * errors.rms(errors.travel, horizon)
        )
        if (errors.rms(errors.noise, horizon) <= allowed).all():
            return horizon
    return possible[-1]
