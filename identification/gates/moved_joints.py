"""Gates of effects that noise may imitate, because noise moves the joints and the controller responds with a torque."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from identification.engine.claims import GateResult, easiest_test
from identification.gates.over_blocks import SIGNIFICANT_ERRORS
from phantom_dyn.array_types import Array, Bool, Float

# share: only joints whose squared residual grows by more than this without the effect are tested. If there is none, the
# effect fails.
VISIBLE_GROWTH = 0.03

# ratio: power density of the torque over that of the residual. Effects that depend on the motion are tested only at
# frequencies with at least this ratio, where noise makes at most a thirtieth of the torque's power. At smaller ratios,
# motion by noise and the response of the controller may look like an inertia or a late torque.
MOVED_BY_NOISE = 30.0


def shown_by_motion(claim: GateResult, held_out: float, in_sample: float, scatter: float, price: float) -> GateResult:
    """Is an effect that depends on the motion visible at frequencies where the torque is far above the noise?

    An effect passes if the gates of the search accept it at these frequencies, or if its gain there (the decrease of
    the squared residual) exceeds both the price of its parameters and the scatter of the gain over blocks.

    Args:
        claim: Result of the search's gates at these frequencies.
        held_out: Gain on held-out data at these frequencies.
        in_sample: Gain in sample at these frequencies.
        scatter: Standard error of the held-out gain over blocks.
        price: Gain that the parameters of the effect have to exceed.
    """
    # The smaller gain counts: a held-out gain exceeds the gain in sample only if a few held-out blocks agree by chance.
    tests = (held_out, SIGNIFICANT_ERRORS * scatter), (min(held_out, in_sample), price)
    # Both tests have to pass, so the result is that of the harder one: one that fails, or passes by the smaller factor.
    harder = min(tests, key=lambda test: (test[0] > test[1], test[0] / max(test[1], 1e-300)))
    ways = [(claim.value, claim.needed, claim.unit)] if claim.passed else []
    return easiest_test("shown by motion", [*ways, (*harder, "gain where the motion is loud")])


def shown_above_noise(
    growth: Float[Array, " nv"],
    over_allowed: Callable[[Bool[Array, " nv"]], Float[Array, " nv"]],
    has_structure: Callable[[Bool[Array, " nv"]], bool],
    in_highest_noise: Callable[[], tuple[float, float]],
) -> GateResult:
    """Is an effect that noise may imitate more than noise?

    An effect passes if there is a gap without it: the residual of some joint is then larger than the joint's noise, or
    has structure or events, which noise of any size does not have. An effect also passes if it gains more than chance
    on joints that have a gap even with the largest possible noise. A stronger effect, or a quieter or longer recording,
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

    found = easiest_test("shown above noise", ways())
    return found if found.passed or not has_structure(grown) else replace(found, passed=True)
