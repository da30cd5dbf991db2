"""The gates of effects that noise may imitate, because it moves the joints and the controller answers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.engine.claims import GateResult, easiest
from identification.gates.over_blocks import SIGNIFICANT_ERRORS
from phantom_dyn.array_types import Float

Array = np.ndarray

# share: by which the squared residual of some joint grows without what noise may make.
VISIBLE_GROWTH = 0.03

# ratio: of the torque's power density to that of what is left, below which what noise moves, and a controller answers,
# may look like an inertia or a late torque. At thirty noise can make a thirtieth of the torque.
MOVED_BY_NOISE = 30.0


def shown_by_motion(claim: GateResult, held_out: float, in_sample: float, scatter: float, price: float) -> GateResult:
    """Does an effect that goes with the motion show where the motion's torque is far above the noise?

    It passes there as any claim does, or with more than its price and than its scatter from block to block.

    Args:
        claim: What decides on it there by the rules of the search.
        held_out: Gain on held-out data there.
        in_sample: Gain in sample.
        scatter: Standard error of the held-out gain over blocks.
        price: Of its parameters.
    """

    def ways() -> Iterator[tuple[float, float, str]]:
        if claim.passed:
            yield claim.value, claim.needed, claim.unit
        # In sample a gain can only be larger, unless chance has made the few held-out blocks agree.
        both = (held_out, SIGNIFICANT_ERRORS * scatter), (min(held_out, in_sample), price)
        least = min(both, key=lambda one: (one[0] > one[1], one[0] / max(one[1], 1e-300)))
        yield *least, "gain where the motion is loud"

    return easiest("shown by motion", ways())


def shown_above_noise(
    growth: Float[Array, " nv"], without: Float[Array, " nv"], highest: Float[Array, " nv"]
) -> GateResult:
    """Is some joint left with more than its noise without an effect that noise may make?

    A stronger effect passes, or a quieter recording.

    Args:
        growth: Relative growth of each joint's squared residual without it.
        without: What is left of each joint without it.
        highest: The most that its noise may be.
    """
    # Both have to be so on one joint: the joint that comes nearest is stated by what it falls shorter of.
    grown, above = growth / VISIBLE_GROWTH, without / highest
    joint = int(np.argmax(np.minimum(grown, above)))
    passed = bool(np.any((growth > VISIBLE_GROWTH) & (without > highest)))
    if grown[joint] < above[joint]:
        return GateResult("shown above noise", float(growth[joint]), VISIBLE_GROWTH, "of the squared residual", passed)
    return GateResult("shown above noise", float(above[joint]), 1.0, "floors", passed)
