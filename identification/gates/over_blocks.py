"""Gate of the distribution over time: does a gain come from more than one or two blocks of the recording?

A block is a stretch of consecutive samples. The gain of an effect is the decrease of the squared residual by the
effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from identification.engine.claims import GateResult, easiest_test
from phantom_dyn.array_types import Array, Float

# standard errors over blocks: a gain larger than this is significant.
SIGNIFICANT_ERRORS = 2.0

# blocks: a gain that is not significant has to be large enough after this many of its best blocks are left out.
BEST_BLOCKS = 2

# blocks: the same for structure in the residual that no effect explains. This structure may be rare, like a contact.
BEST_BLOCKS_NAMELESS = 1

# times the gain that the claim needs: a gain larger than this passes even if it comes from few blocks.
LARGE_GAIN = 10.0

# share: an effect acts in a block if the energy (sum of squares) of its columns there is above this share of the
# largest energy in any block.
ACTING = 0.1

# share of the blocks: an effect with energy in fewer blocks passes if it gains in each block where it acts. An example
# is half a dozen events in a recording of twenty blocks.
RARE = 0.35


def in_enough_blocks(
    gains: Float[Array, " B"],
    held_out: float,
    gain: float,
    needed: float,
    energy: Callable[[], Float[Array, " B"]],
    *,
    named: bool,
) -> GateResult:
    """Does the gain come from the whole recording, or from every block where the effect acts?

    An effect passes if its gain is significant over the blocks, or large enough without its best blocks, or ten times
    the needed gain. An effect that is zero most of the time, such as a saturation that a command reaches twice, passes
    if it gains in every block where it acts.

    Args:
        gains: Held-out gain of each block.
        held_out: Held-out gain of all blocks, minus the change of the penalty on changes within tolerance.
        gain: Held-out gain or in-sample gain, whichever is smaller.
        needed: Gain that the claim needs.
        energy: Gives the energy of the effect's columns in each block, divided by the largest of these energies.
        named: False for structure in the residual that no effect of the catalogue explains.
    """
    few = BEST_BLOCKS if named else BEST_BLOCKS_NAMELESS

    def ways() -> Iterator[tuple[float, float, str]]:
        yield held_out, SIGNIFICANT_ERRORS * (float(np.sqrt(len(gains)) * gains.std()) + 1e-12), "gain"
        yield held_out - float(np.sort(gains)[-few:].sum()), needed, "gain without its best blocks"
        acting = energy()
        if (acting > 0.0).mean() < RARE:
            yield float(gains[acting > ACTING].min(initial=np.inf)), 0.0, "gain of the least block where it acts"
        yield gain, LARGE_GAIN * needed, "gain"

    return easiest_test("in enough blocks", ways())
