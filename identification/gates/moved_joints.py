"""The gates of effects that noise may imitate: it moves the joints, and the controller answers with a torque."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.engine.claims import GateResult, easiest
from identification.gates.over_blocks import SIGNIFICANT_ERRORS
from phantom_dyn.array_types import Float

Array = np.ndarray

# share: by which the squared residual of some joint has to grow without an effect that noise may imitate.
VISIBLE_GROWTH = 0.03

# ratio: of the power density of the torque to that of the residual. Below it, motion by noise and the controller's
# answer may look like an inertia or a late torque. At thirty noise can make a thirtieth of the torque.
MOVED_BY_NOISE = 30.0


def shown_by_motion(claim: GateResult, held_out: float, in_sample: float, scatter: float, price: float) -> GateResult:
    """Does an effect that depends on the motion show at frequencies where the torque is far above the noise?

    It passes if the rules of the search accept it there, or if its gain there exceeds its price and its scatter over
    blocks.

    Args:
        claim: Result of the search's gates there.
        held_out: Gain on held-out data there.
        in_sample: Gain in sample there.
        scatter: Standard error of the held-out gain over blocks.
        price: Of its parameters.
    """

    def ways() -> Iterator[tuple[float, float, str]]:
        if claim.passed:
            yield claim.value, claim.needed, claim.unit
        # A gain in sample is larger than a held-out one, unless the few held-out blocks agree by chance.
        both = (held_out, SIGNIFICANT_ERRORS * scatter), (min(held_out, in_sample), price)
        least = min(both, key=lambda one: (one[0] > one[1], one[0] / max(one[1], 1e-300)))
        yield *least, "gain where the motion is loud"

    return easiest("shown by motion", ways())


def shown_above_noise(
    growth: Float[Array, " nv"], without: Float[Array, " nv"], highest: Float[Array, " nv"]
) -> GateResult:
    """Without an effect that noise may imitate, is the residual of some joint above its noise?

    A stronger effect passes, or a quieter recording.

    Args:
        growth: Relative growth of each joint's squared residual without it.
        without: Residual of each joint without it.
        highest: Upper end of each joint's noise floor.
    """
    # One joint has to pass both limits. If none does, the result states the one that the nearest joint misses by more.
    grown, above = growth / VISIBLE_GROWTH, without / highest
    joint = int(np.argmax(np.minimum(grown, above)))
    passed = bool(np.any((growth > VISIBLE_GROWTH) & (without > highest)))
    if grown[joint] < above[joint]:
        return GateResult("shown above noise", float(growth[joint]), VISIBLE_GROWTH, "of the squared residual", passed)
    return GateResult("shown above noise", float(above[joint]), 1.0, "floors", passed)
