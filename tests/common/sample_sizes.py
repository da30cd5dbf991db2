"""A size of any effect of the catalogue, for tests that put each of them into a robot."""

import numpy as np

from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot


def sample_size(effect: Effect, robot: Robot, joint: str | None) -> dict[str, float]:
    """A third of a unit of each parameter, or as much of it as a sound device may have."""
    out = {}
    for one in effect.parameters(robot, joint):
        low, high = (one.lower, one.upper) if one.plausible is None else one.plausible
        out[one.name] = float(np.clip(1.0 / 3.0, low, high))
    return out
