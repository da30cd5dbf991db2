"""The Laparoscopic Surgical Workstation of Immersion as devices: travel, encoder and motor of each axis.

It is the good device on which the paper simulates cheap ones (Brouwer, MacLean and Hodgson, Simulating Cheap Hardware,
Table 1). The tip's twist has an encoder and no motor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis


@dataclass(frozen=True)
class WorkstationAxis:
    """One axis: SI units, radians and newton metres where it turns.

    Attributes:
        travel: Range [m or rad]; infinite where it turns without a stop.
        continuous: Force or torque that the motor holds for any time [N or N m]; 0 without a motor.
        peak: That it holds for a moment.
        resolution: Step of its encoder [m or rad].
        turns: True if it is rotary.
    """

    travel: float
    continuous: float
    peak: float
    resolution: float
    turns: bool = True

    @property
    def motor(self) -> CheapAxis:
        """What clips a force that is asked for, for any time."""
        return CheapAxis(limit=self.continuous)


def _turning(travel: float, continuous: float, peak: float, resolution: float) -> WorkstationAxis:
    """A rotary axis from degrees."""
    return WorkstationAxis(math.radians(travel), continuous, peak, math.radians(resolution))


WORKSTATION: Mapping[str, WorkstationAxis] = MappingProxyType(
    {
        "insertion": WorkstationAxis(0.170, 11.0, 19.0, 0.008e-3, turns=False),
        "pitch": _turning(100.0, 0.47, 0.85, 0.01),
        "yaw": _turning(100.0, 0.47, 0.85, 0.01),
        "handle twist": _turning(180.0, 0.04, 0.07, 0.03),
        "tip twist": _turning(math.inf, 0.0, 0.0, 0.7),
        "handle grip": _turning(20.0, 0.15, 0.32, 0.04),
    }
)
"""Table 1."""
