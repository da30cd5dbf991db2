"""A load without the noise of accelerations, so that what it is multiplied by keeps its steps in a wider band."""

from __future__ import annotations

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.operation import Operation
from phantom_dyn.signals.recursive import low_passed

# Number of poles of the filter that is applied forwards and backwards.
_POLES = 4


def up_to_band(operation: Operation, load: Float[Array, " N"]) -> Float[Array, " N"]:
    """A load up to the edge of the judged band, as above it accelerations are noisy.

    Args:
        operation: Gives the band and the rate.
        load: Torque that the transmission of a joint passes to its link [N m or N].
    """
    if not 0.0 < operation.band_hz * operation.dt < 0.5:
        return load
    return low_passed(load, operation.band_hz, 1.0 / operation.dt, order=_POLES)
