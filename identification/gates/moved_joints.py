"""Gates of effects that noise may imitate, because noise moves the joints and the controller responds with a torque."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from identification.engine.claims import GateResult, easiest
from identification.gates.over_blocks import SIGNIFICANT_ERRORS
from phantom_dyn.array_types import Array, Bool, Float

# share: without the effect, the squared residual of some joint has to grow by more than this.
VISIBLE_GROWTH = 0.03

# ratio: least power density of the torque over that of the residual at frequencies where effects are tested. There
# noise makes at most a thirtieth of the torque's power. At smaller ratios, motion by noise and the response of the
# controller may look like an inertia or a late torque.
MOVED_BY_NOISE = 30.0


def shown_by_motion(claim: GateResult, held_out: float, in_sample: float, scatter: float, price: float) -> GateResult:
    """Does an effect that depends on the motion show at frequencies where the torque is far above the noise?

    An effect passes if the gates of the search accept it at these frequencies, or if its gain there exceeds both the
    price of its parameters and the scatter of the gain over blocks.

    Args:
        claim: Result of the search's gates at these frequencies.
        held_out: Gain on held-out data at these frequencies.
        in_sample: Gain in sample at these frequencies.
        scatter: Standard error of the held-out gain over blocks.
        price: Gain that the parameters of the effect have to exceed.
    """
    # Both gains count: a held-out gain exceeds the gain in sample only if a few held-out blocks agree by chance.
    gains = (held_out, SIGNIFICANT_ERRORS * scatter), (min(held_out, in_sample), price)
    smaller = min(gains, key=lambda gain: (gain[0] > gain[1], gain[0] / max(gain[1], 1e-300)))
    ways = [(claim.value, claim.needed, claim.unit)] if claim.passed else []
    return easiest("shown by motion", [*ways, (*smaller, "gain where the motion is loud")])


def shown_above_noise(
    growth: Float[Array, " nv"],
    over_allowed: Callable[[Bool[Array, " nv"]], Float[Array, " nv"]],
    has_structure: Callable[[Bool[Array, " nv"]], bool],
    in_highest_noise: Callable[[], tuple[float, float]],
) -> GateResult:
    """Is an effect that noise may imitate more than noise?

    An effect passes if there would be a gap without it: the residual of some joint is then larger than its noise, or
    has structure or events, which noise of any size does not have. It also passes if it gains more than chance on
    joints that have a gap even with the largest possible noise. A stronger effect, or a quieter or longer recording,
    would pass.

    Args:
        growth: Relative growth of each joint's squared residual without the effect.
        over_allowed: Residual of the given joints without the effect, divided by the largest residual that noise and
            the error of a sound model may leave.
        has_structure: True if that residual of the given joints has structure or events.
        in_highest_noise: Gain on joints that have a gap even with their largest possible noise, and the gain by chance.
    """
    grown = growth > VISIBLE_GROWTH
    if not grown.any():
        return GateResult("shown above noise", float(growth.max()), VISIBLE_GROWTH, "of the squared residual", False)

    def ways() -> Iterator[tuple[float, float, str]]:
        yield float(over_allowed(grown)[grown].max()), 1.0, "floors"
        yield *in_highest_noise(), "gain in the loudest noise"

    found = easiest("shown above noise", ways())
    return found if found.passed or not has_structure(grown) else replace(found, passed=True)
