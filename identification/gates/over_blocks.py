"""The gate of time: a gain has to hold in more than a block or two of the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from identification.engine.claims import GateResult, easiest
from phantom_dyn.array_types import Float

Array = np.ndarray

# standard errors over blocks: by which a gain has to be positive.
SIGNIFICANT_ERRORS = 2.0

# blocks: without which a gain still has to hold, if it is not significant from block to block.
BEST_BLOCKS = 2

# blocks: the same of a structure without a name, which may act more rarely, as a contact does.
BEST_BLOCKS_NAMELESS = 1

# thresholds: from which on a gain may sit in few blocks.
LARGE_GAIN = 10.0

# share: of the energy of an effect's columns in the block with most of it, from which on a block has to gain by it.
ACTING = 0.1

# share of the blocks: an effect that is zero in all others acts so rarely that it is judged where it acts. Half a dozen
# events in a recording of twenty blocks are fewer.
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
    """Does the gain hold all along the recording, or wherever the effect acts, and not in a block or two alone?

    It passes if it is significant from block to block, or enough without its best blocks, or ten times what is needed.
    An effect that is zero most of the time, as a saturation that a command reaches twice, passes if it gains in every
    block where it acts.

    Args:
        gains: Held-out gain of each block.
        held_out: Held-out gain of all, with what the moves of the model cost.
        gain: The smaller of that and the gain in sample.
        needed: What the claim needs.
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
