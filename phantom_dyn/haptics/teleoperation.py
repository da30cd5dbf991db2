r"""Two devices tied by force feedback of their position error, as in section 5 of Cavusoglu, Feygin and Tendick (2002).

Master and slave are pushed by :math:`\mp (G + B\,\hat v)` of the difference of their positions. Only the difference is
fed back, and it answers a force as both devices in parallel do: equal devices bear half the gain of one on a wall.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from phantom_dyn.haptics.arguments import sample_count
from phantom_dyn.haptics.discretisation import SampledAxis, discretise
from phantom_dyn.haptics.loop_simulation import LoopSettings, LoopTrace, gain_until_swinging, simulate_loop
from phantom_dyn.haptics.sampled_loop import (
    NOTHING,
    UNFILTERED,
    CriticalGain,
    DigitalFilter,
    SampledLoop,
    critical_gain,
)
from phantom_dyn.haptics.transfer_function import Axis
from phantom_dyn.haptics.virtual_wall import velocity_filter


def critical_loop_gain(master: Axis, slave: Axis, settings: LoopSettings, *, damping: float = 0.0) -> CriticalGain:
    """Largest gain [N/m] of the position error, with a damping of its estimated rate beside it, rounding left out.

    Args:
        master: The device in the operator's hand; `held_by` of an axis puts the hand on it.
        slave: The other device.
        settings: Sampling and estimator of both.
        damping: Of the estimated rate of the error [N s/m].

    Raises:
        ParameterError: If there is damping and the estimator is adaptive windowing.
    """
    first, second = (discretise(axis, period=settings.period, delay=settings.delay) for axis in (master, slave))
    fixed = NOTHING
    if damping != 0.0:
        rate = velocity_filter(settings.estimator, step=settings.encoder.step, period=settings.period)
        fixed = DigitalFilter(damping * rate.numerator, rate.denominator)
    return critical_gain(SampledLoop(_difference(first, second), scaled=UNFILTERED, fixed=fixed))


def simulate_teleoperation(
    master: Axis,
    slave: Axis,
    settings: LoopSettings,
    gain: float,
    *,
    damping: float = 0.0,
    offset: float = 2e-3,
    duration: float = 2.0,
) -> LoopTrace:
    """Master and slave let go in free space `offset` [m] apart; column 0 of the traces is the master."""
    hand = np.zeros((sample_count(duration, settings.period), 2))
    return simulate_loop(
        (master, slave), settings, gain=gain, damping=damping, start=(offset, 0.0), speed=(0.0, 0.0), hand=hand
    )


def simulated_loop_gain(
    master: Axis,
    slave: Axis,
    settings: LoopSettings,
    *,
    low: float,
    high: float,
    damping: float = 0.0,
    offset: float = 2e-3,
    duration: float = 2.0,
) -> float:
    """Gain [N/m] at which master and slave begin to swing on against each other, encoders and all."""
    run = partial(simulate_teleoperation, master, slave, settings, damping=damping, offset=offset, duration=duration)
    return gain_until_swinging(run, settings.encoder.step, low=low, high=high)


def _difference(first: SampledAxis, second: SampledAxis) -> tuple[SampledAxis, ...]:
    """What the difference of both positions sees. Of equal devices one, twice: no force moves both together."""
    arrays = ("transition", "newer", "older", "output")
    if all(np.array_equal(getattr(first, name), getattr(second, name)) for name in arrays):
        twice = 2 * first.output
        direct = {"direct_now": 2 * first.direct_now, "direct_before": 2 * first.direct_before}
        return (replace(first, output=twice, **direct),)
    return (first, second)
