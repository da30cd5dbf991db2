"""The gates of effects that noise may imitate: it moves the joints, and the controller answers with a torque."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from identification.engine.claims import GateResult, easiest
from identification.gates.over_blocks import SIGNIFICANT_ERRORS
from phantom_dyn.array_types import Array, Bool, Float

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
    growth: Float[Array, " nv"],
    without: Callable[[Bool[Array, " nv"]], Float[Array, " nv"]],
    has_structure: Callable[[], bool],
    loudest: Callable[[], tuple[float, float]],
) -> GateResult:
    """Is an effect that noise may imitate more than noise?

    It is if there would be a gap without it: the residual of some joint is larger than its noise, or has structure or
    events, which noise does not have, however large it is. It is, too, if it gains more than chance on joints that have
    a gap even with the largest possible noise. A stronger effect, a quieter recording or a longer one would pass.

    Args:
        growth: Relative growth of each joint's squared residual without it.
        without: Residual of some joints without it, over the largest that may be noise and the error of a sound model.
        has_structure: Whether that residual has structure or events.
        loudest: Gain on joints with a gap if the noise of each is as large as it may be, and what chance gains.
    """
    grown = growth > VISIBLE_GROWTH
    if not grown.any():
        return GateResult("shown above noise", float(growth.max()), VISIBLE_GROWTH, "of the squared residual", False)

    def ways() -> Iterator[tuple[float, float, str]]:
        yield float(without(grown)[grown].max()), 1.0, "floors"
        yield *loudest(), "gain in the loudest noise"

    found = easiest("shown above noise", ways())
    return found if found.passed or not has_structure() else replace(found, passed=True)
