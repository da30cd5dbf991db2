"""Critical stiffness over damping of the device, virtual damping, delay and period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.compiled import map_lowest_gain
from phantom_dyn.haptics.discretisation import split_delay
from phantom_dyn.haptics.stability import linear_stiffness, lowest_frequency, roots_of_modes
from phantom_dyn.motion import read_only

Array = np.ndarray
Values = Sequence[float] | Float[Array, " _"]


@dataclass(frozen=True)
class StabilityMap:
    """Critical stiffness on a grid; the axes of each array are those of the first four fields.

    Attributes:
        damping: Added to the motor's own [N s/m or N m s/rad], shape ``(i,)``.
        virtual_damping: Of the wall, shape ``(j,)``.
        delay: Beside the hold [s], shape ``(k,)``.
        period: Of sampling [s], shape ``(m,)``.
        stiffness: Critical stiffness [N/m or N m/rad]; 0 where no wall is stable.
        frequency: Of the oscillation at the edge [rad/s]; NaN where no wall is stable.
        linear: Critical stiffness by the linear condition (10).
    """

    damping: Float[Array, " i"]
    virtual_damping: Float[Array, " j"]
    delay: Float[Array, " k"]
    period: Float[Array, " m"]
    stiffness: Float[Array, "i j k m"]
    frequency: Float[Array, "i j k m"]
    linear: Float[Array, "i j k m"]

    def __post_init__(self):
        for name in ("damping", "virtual_damping", "delay", "period", "stiffness", "frequency", "linear"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def ratio(self) -> Float[Array, "i j k m"]:
        """Exact critical stiffness over that of the linear condition; NaN where that leaves no wall."""
        out = np.full(self.stiffness.shape, np.nan)
        return np.divide(self.stiffness, self.linear, out=out, where=self.linear > 0)


def stability_map(
    axis: RigidAxis | TwoMassAxis,
    *,
    period: Values,
    delay: Values = (0.0,),
    damping: Values = (0.0,),
    virtual_damping: Values = (0.0,),
) -> StabilityMap:
    """Critical stiffness for every combination, each as exact as that of `critical_stiffness`.

    Args:
        axis: Model of the device.
        period: Sampling periods [s].
        delay: Delays of the loop beside the hold [s].
        damping: Added to that of the motor [N s/m or N m s/rad].
        virtual_damping: Of the wall, on the backward difference of the position.

    Raises:
        ParameterError: If a sequence is empty or none, a period is not positive, a delay or damping is negative, or a
            number not finite.
    """
    values = {"period": period, "delay": delay, "damping": damping, "virtual_damping": virtual_damping}
    for name, given in values.items():
        if np.ndim(given) != 1 or len(given) == 0:
            raise ParameterError(f"The {name} of the map is {given}: give a sequence of at least one number.")
    added, virtual, delays, periods = (
        np.array(values[name], dtype=float) for name in ("damping", "virtual_damping", "delay", "period")
    )
    devices = [axis.damped(float(extra)) for extra in added]
    splits = [[split_delay(float(T), float(late)) for T in periods] for late in delays]
    steps = np.array([[whole for whole, _ in row] for row in splits], dtype=np.int64)
    rest = np.array([[part for _, part in row] for row in splits])
    low, linear = (np.empty((len(added), len(virtual), len(delays), len(periods))) for _ in range(2))
    found = [roots_of_modes(device) for device in devices]
    for (i, j, k, m), _ in np.ndenumerate(low):
        T, late, B = float(periods[m]), float(delays[k]), float(virtual[j])
        low[i, j, k, m] = lowest_frequency(devices[i], found[i][1], T, late, B)
        rigid = devices[i].rigid if isinstance(devices[i], TwoMassAxis) else devices[i]
        linear[i, j, k, m] = linear_stiffness(rigid.damping, period=T, delay=late, virtual_damping=B)
    stiffness, frequency = np.empty_like(low), np.empty_like(low)
    systems = [device.state_space for device in devices]
    A = np.stack([system.A for system in systems])
    modes = _same_length([modes for modes, _ in found])
    map_lowest_gain(A, systems[0].B, systems[0].C, low, modes, periods, virtual, steps, rest, stiffness, frequency)
    return StabilityMap(added, virtual, delays, periods, stiffness, frequency, linear)


def _same_length(modes: list[Float[Array, "_ 2"]]) -> Float[Array, "i most 2"]:
    """Modes of all devices in one array: frequency 0 fills up where damping has taken one."""
    most = max(len(part) for part in modes)
    out = np.zeros((len(modes), most, 2))
    for row, part in zip(out, modes, strict=True):
        row[: len(part)] = part
    return out
