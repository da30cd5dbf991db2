r"""Safety logic of a haptic driver: force off if updates come too slowly, current off if the motor is too warm.

Cavusoglu, Feygin and Tendick (2002, section 4.2.1): without the stock amplifier box "the update rate and temperature
control safety logic are bypassed as well. It is therefore important to implement these in the drivers for the new
amplifiers." The paper gives neither rates nor temperatures, so both are inputs.

**Update rate.** A driver that has waited longer than :math:`1/f` for a command gives no force until it is armed again,
because the first command after an interruption must not cause a sudden force.

**Temperature.** One thermal mass, as in `phantom_dyn.haptics.device.drives`:
:math:`\tau\,\dot\Theta = R_{th} R\,i^2 - \Theta`, integrated exactly for a held current. The current is switched off at
the warmest allowed rise, and on again when the motor has cooled to a lower one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_numbers, require_positive

# Relative tolerance of the waiting time, because a sum of time steps that equals the limit has rounding errors.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class ThermalMotor:
    """A motor that is warmed by its winding.

    Attributes:
        resistance: Resistance of the winding [ohm].
        thermal_resistance: Thermal resistance from winding to room [K/W].
        time_constant: Thermal time constant [s].

    Raises:
        ParameterError: If a value is not above 0.
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
        """Final temperature rise [K] under a constant current [A]: R_th R i^2."""
        return self.thermal_resistance * self.resistance * current**2

    def rise_after(self, rise: float, current: float, dt: float) -> float:
        """Temperature rise [K] after a constant current [A] for ``dt`` [s], starting from ``rise`` [K]."""
        decay = math.exp(-dt / self.time_constant)
        return rise * decay + self.steady_rise(current) * -math.expm1(-dt / self.time_constant)


@dataclass(frozen=True)
class Guard:
    """Limits of a driver.

    Attributes:
        motor: The motor whose temperature is estimated.
        current_per_force: Current per force [A/N or A/(N m)].
        slowest: Update rate below which the force is switched off [Hz].
        warmest: Temperature rise at which the current is switched off [K].
        cool: Temperature rise at which the current is switched on again [K].

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
    """Memory of a driver between cycles, made by `armed`.

    Attributes:
        command: The last command [N or N m].
        waited: Time since the last command [s].
        rise: Estimated temperature rise of the motor [K].
        late: True if a command came too late since the driver was armed.
        hot: True if the motor was too warm and has not cooled down yet.
    """

    command: float
    waited: float
    rise: float
    late: bool
    hot: bool


@dataclass(frozen=True)
class GuardTrace:
    """A driver over ``N`` cycles.

    Attributes:
        force: Output force of the driver [N or N m], shape ``(N,)``.
        rise: Temperature rise of the motor at the end of each cycle [K], shape ``(N,)``.
        late: True where the force is off because of slow updates, shape ``(N,)``.
        hot: True where the force is off because of temperature, shape ``(N,)``.
    """

    force: Float[Array, " N"]
    rise: Float[Array, " N"]
    late: Bool[Array, " N"]
    hot: Bool[Array, " N"]


def armed(state: GuardState | None = None) -> GuardState:
    """State of a driver that was just switched on, before the first command; the motor keeps its temperature."""
    fresh = GuardState(0.0, 0.0, 0.0, late=False, hot=False)
    return fresh if state is None else replace(fresh, rise=state.rise, hot=state.hot)


def guarded(guard: Guard, state: GuardState, dt: float, command: float | None) -> tuple[GuardState, float]:
    """One cycle of a driver: its next state, and its output force [N or N m].

    Args:
        guard: Limits of the driver.
        state: State after the cycle before, or `armed`.
        dt: Length of the cycle [s].
        command: Force that the computer commanded during the cycle; None if no command came.

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
    """A driver over cycles of ``dt`` [s], armed and cold at the start.

    Args:
        guard: Limits of the driver.
        dt: Length of a cycle [s].
        commands: Commanded force in each cycle [N or N m], NaN where no command came, shape ``(N,)``.
    """
    state = armed()
    force, rise = np.zeros(len(commands)), np.zeros(len(commands))
    late, hot = np.zeros(len(commands), dtype=bool), np.zeros(len(commands), dtype=bool)
    for k, command in enumerate(commands):
        state, force[k] = guarded(guard, state, dt, None if math.isnan(command) else float(command))
        rise[k], late[k], hot[k] = state.rise, state.late, state.hot
    return GuardTrace(force, rise, late, hot)
