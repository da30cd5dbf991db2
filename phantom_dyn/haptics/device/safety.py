r"""Safety logic of a haptic driver: force off when updates come too slowly, current off when the motor is too warm.

Cavusoglu, Feygin and Tendick (2002, section 4.2.1): without the stock amplifier box "the update rate and temperature
control safety logic are bypassed as well. It is therefore important to implement these in the drivers for the new
amplifiers." The paper gives neither rates nor temperatures, so both are inputs.

**Update rate.** A driver that has waited longer than :math:`1/f` for a command gives no force, and gives none until it
is armed again: a computer that comes back late must not push at once.

**Temperature.** One thermal mass, as in `phantom_dyn.haptics.device.drives`:
:math:`\tau\,\dot\Theta = R_{th} R\,i^2 - \Theta`, stepped exactly for a current that is held. At the warmest allowed
rise the current goes off; it comes back when the motor has cooled to the lower one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.number_checks import require_numbers, require_positive

_ROUNDING = 1e-9
"""Of the time waited, relative: a driver's clock that adds up to the limit has not passed it."""


@dataclass(frozen=True)
class ThermalMotor:
    """A motor as its winding warms it.

    Attributes:
        resistance: Of the winding [ohm].
        thermal_resistance: From winding to room [K/W].
        time_constant: Of the warming [s].

    Raises:
        ParameterError: If one is not above 0.
    """

    resistance: float
    thermal_resistance: float
    time_constant: float

    def __post_init__(self) -> None:
        require_positive(
            resistance_of_the_winding=self.resistance,
            thermal_resistance=self.thermal_resistance,
            thermal_time_constant=self.time_constant,
        )

    def steady_rise(self, current: float) -> float:
        """Rise [K] that a current [A] ends at: R_th R i^2."""
        return self.thermal_resistance * self.resistance * current**2

    def rise_after(self, rise: float, current: float, dt: float) -> float:
        """Rise [K] after ``dt`` [s] of a held current [A], from a rise before."""
        kept = math.exp(-dt / self.time_constant)
        return rise * kept + self.steady_rise(current) * -math.expm1(-dt / self.time_constant)


@dataclass(frozen=True)
class Guard:
    """Limits of a driver.

    Attributes:
        motor: Whose temperature is followed.
        current_per_force: Current of a force [A/N or A/(N m)].
        slowest: Update rate below which the force goes off [Hz].
        warmest: Rise at which the current goes off [K].
        cool: Rise to which the motor has to cool before it comes back [K].

    Raises:
        ParameterError: If a limit is not above 0, or the cool rise not below the warmest.
    """

    motor: ThermalMotor
    current_per_force: float
    slowest: float
    warmest: float
    cool: float

    def __post_init__(self) -> None:
        require_positive(
            current_per_force=self.current_per_force,
            slowest_update_rate=self.slowest,
            warmest_rise=self.warmest,
            cool_rise=self.cool,
        )
        if self.cool >= self.warmest:
            raise ParameterError(
                f"The motor is to come back at {self.cool:g} K and goes off at {self.warmest:g} K: give a cooler rise "
                "to come back at."
            )


@dataclass(frozen=True)
class GuardState:
    """What a driver knows; made by `armed`.

    Attributes:
        command: The last one [N or N m].
        waited: Since then [s].
        rise: Of the motor [K], as estimated.
        late: Whether updates came too slowly since it was armed.
        hot: Whether the motor was too warm and has not cooled yet.
    """

    command: float
    waited: float
    rise: float
    late: bool
    hot: bool


@dataclass(frozen=True)
class GuardTrace:
    """A driver over time, ``N`` cycles.

    Attributes:
        force: That it lets through [N or N m], shape ``(N,)``.
        rise: Of the motor at the end of each cycle [K], shape ``(N,)``.
        late: Off for slow updates, shape ``(N,)``.
        hot: Off for temperature, shape ``(N,)``.
    """

    force: Float[Array, " N"]
    rise: Float[Array, " N"]
    late: Bool[Array, " N"]
    hot: Bool[Array, " N"]


def armed(state: GuardState | None = None) -> GuardState:
    """A driver that is switched on, without a command yet; a motor that is warm stays warm."""
    fresh = GuardState(0.0, 0.0, 0.0, late=False, hot=False)
    return fresh if state is None else replace(fresh, rise=state.rise, hot=state.hot)


def guarded(guard: Guard, state: GuardState, dt: float, command: float | None) -> tuple[GuardState, float]:
    """One cycle of a driver: the state after it, and the force that it lets through [N or N m].

    Args:
        guard: Its limits.
        state: Of the cycle before, or `armed`.
        dt: Length of the cycle [s].
        command: Force that the computer has asked for since, or None if it has not.

    Raises:
        ParameterError: If the cycle is not above 0, or the command no number.
    """
    require_positive(cycle=dt)
    waited = state.waited + dt
    late = state.late or waited > (1.0 + _ROUNDING) / guard.slowest
    asked = state.command
    if command is not None:
        require_numbers(command=command)
        asked, waited = float(command), 0.0
    hot = state.rise >= guard.warmest or (state.hot and state.rise > guard.cool)
    force = 0.0 if late or hot else asked
    rise = guard.motor.rise_after(state.rise, guard.current_per_force * force, dt)
    return GuardState(asked, waited, rise, late, hot), force


def run_guard(guard: Guard, dt: float, commands: Float[Array, " N"]) -> GuardTrace:
    """A driver over cycles of ``dt`` [s], armed and cold at first.

    Args:
        guard: Its limits.
        dt: Length of a cycle [s].
        commands: Force asked for in each cycle [N or N m], NaN where no update came, shape ``(N,)``.
    """
    state = armed()
    force, rise = np.zeros(len(commands)), np.zeros(len(commands))
    late, hot = np.zeros(len(commands), dtype=bool), np.zeros(len(commands), dtype=bool)
    for k, command in enumerate(commands):
        state, force[k] = guarded(guard, state, dt, None if math.isnan(command) else float(command))
        rise[k], late[k], hot[k] = state.rise, state.late, state.hot
    return GuardTrace(force, rise, late, hot)
