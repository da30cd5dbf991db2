"""The gate of time: does a gain hold in more than one or two blocks of the recording?"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from identification.engine.claims import GateResult, easiest
from phantom_dyn.array_types import Array, Float

# standard errors over blocks: least size of a significant gain.
SIGNIFICANT_ERRORS = 2.0

# blocks: without its best blocks a gain that is not significant still has to hold.
BEST_BLOCKS = 2

# blocks: the same for a structure without a name, which may act more rarely, as a contact does.
BEST_BLOCKS_NAMELESS = 1

# times: the threshold of the claim, above which a gain may be in few blocks.
LARGE_GAIN = 10.0

# share: of the largest energy of an effect's columns in a block, above which a block counts as one where it acts.
ACTING = 0.1

# share of the blocks: an effect that acts in fewer is tested in these alone. Half a dozen events in a recording of
# twenty blocks are fewer.
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
    """Does the gain hold all along the recording, or wherever the effect acts?

    It passes if it is significant over the blocks, or enough without its best blocks, or ten times what is needed. An
    effect that is zero most of the time, as a saturation that a command reaches twice, passes if it gains in every
    block where it acts.

    Args:
        gains: Held-out gain of each block.
        held_out: Held-out gain of all blocks, less the change of the penalty on the moves.
        gain: The smaller of that and the gain in sample.
        needed: Gain that the claim needs.
        energy: Of the effect's columns in each block, over that in the block with most of it.
        named: False for a structure without a name.
    """
    few = BEST_BLOCKS if named else BEST_BLOCKS_NAMELESS

    def ways() -> Iterator[tuple[float, float, str]]:
        yield held_out, SIGNIFICANT_ERRORS * (float(np.sqrt(len(gains)) * gains.std()) + 1e-12), "gain"
        yield held_out - float(np.sort(gains)[-few:].sum()), needed, "gain without its best blocks"
        acting = energy()
        if (acting > 0.0).mean() < RARE:
            yield float(gains[acting > ACTING].min(initial=np.inf)), 0.0, "gain of the least block where it acts"
        yield gain, LARGE_GAIN * needed, "gain"

    return easiest("in enough blocks", ways())
