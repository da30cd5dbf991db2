"""White-noise experiment on a device: it is driven by noise, and its position is read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.experiments.frequency_response import FrequencyResponse, estimate_frequency_response
from phantom_dyn.haptics.experiments.relay import held_forces
from phantom_dyn.haptics.number_checks import require_not_negative, sample_count
from phantom_dyn.motion import read_only


@dataclass(frozen=True)
class WhiteNoiseExperiment:
    """Recorded force and position.

    Attributes:
        period: Sampling period [s].
        force: Commanded by the computer [N or N m], shape ``(N,)``.
        position: Read by the encoder [m or rad], shape ``(N,)``.
    """

    period: float
    force: Float[Array, " N"]
    position: Float[Array, " N"]

    def __post_init__(self):
        for name in ("force", "position"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def frequency_response(self, *, segment: float) -> FrequencyResponse:
        """Empirical transfer function from segments of this length [s]."""
        return estimate_frequency_response(self.force, self.position, period=self.period, segment=segment)


def simulate_white_noise(
    axis: RigidAxis | TwoMassAxis,
    *,
    period: float,
    delay: float = 0.0,
    force: float,
    position_noise: float,
    duration: float,
    rng: np.random.Generator,
) -> WhiteNoiseExperiment:
    """Device driven by white noise behind hold and delay, from rest, its position read with white noise.

    Args:
        axis: Model of the device.
        period: Sampling period [s].
        delay: Of the loop beside the hold [s].
        force: Standard deviation of the force [N or N m].
        position_noise: Standard deviation of the reading [m or rad].
        duration: [s].
        rng: Draws force and noise.

    Raises:
        ParameterError: If a deviation is negative, or period or duration are not positive.
    """
    require_not_negative(force=force, position_noise=position_noise)
    given = force * rng.standard_normal(sample_count(duration, period))
    s = discretise(axis, period=period, delay=delay)
    position = held_forces(s.transition, s.newer, s.older, s.output, s.steps, axis.rest(0.0), given)
    return WhiteNoiseExperiment(period, given, position + position_noise * rng.standard_normal(len(given)))
