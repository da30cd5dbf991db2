"""The force that a hand feels on a cheaper device, from what it does with a good one and what is rendered to it.

One model of one degree of freedom per motor, composed as in Figure 7 of Brouwer and MacLean, Simulating Cheap Hardware:

- what the virtual environment asks for is clipped at the motor's limit (`phantom_dyn.effects.drive.torque_saturation`);
- cogging at the probe's position (`phantom_dyn.effects.drive.cogging`) and friction that sticks, of the probe's
  position and velocity (`phantom_dyn.effects.friction.presliding_friction`), are added without the coupling in between;
- the gap's switch lets all of this through while the probe presses a wall, and blocks it in between;
- the force of the virtual mass, averaged, is added in the end (`phantom_dyn.haptics.cheap.cheap_cycle`).

The sampling rate may change from sample to sample: the published one went from 500 to 2000 Hz. An average over 25
samples delays the inertia by 24, 12 or 6 ms at 500, 1000 or 2000 Hz. An encoder of 8 um gives speeds in steps of 4, 8
and 16 mm/s there, against a stick velocity of 5 mm/s: without the velocity's filter friction would not stick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis
from phantom_dyn.haptics.cheap.cheap_cycle import (
    COLUMNS,
    COUPLING,
    FORCE,
    PROBE_SPEED,
    SIDE,
    STICKS,
    V,
    X,
    along,
    at_rest,
    axis_numbers,
)
from phantom_dyn.haptics.number_checks import require_columns, require_not_negative, require_numbers


@dataclass(frozen=True)
class Rendered:
    """What a hand feels over ``N`` samples, and the states behind it; each of shape ``(N,)``.

    Attributes:
        force: On the hand [N or N m].
        coupling: Of the virtual mass on the probe, before it is averaged.
        mass_position: Of the virtual mass; that of the probe where there is none.
        mass_velocity: Of the virtual mass.
        velocity: Of the probe, as filtered.
        contact: True where the probe presses a wall of the gap.
        stuck: True where the friction sticks.
    """

    force: Float[Array, " N"]
    coupling: Float[Array, " N"]
    mass_position: Float[Array, " N"]
    mass_velocity: Float[Array, " N"]
    velocity: Float[Array, " N"]
    contact: Bool[Array, " N"]
    stuck: Bool[Array, " N"]


def felt(
    axis: CheapAxis, state: Float[Array, " s"], dt: float, x: float, force: float
) -> tuple[Float[Array, " s"], float]:
    """The next state, and the force on the hand: one cycle of a controller.

    Args:
        axis: What is cheap.
        state: Of the cycle before, or `at_rest`; it is left as it is.
        dt: Time since the cycle before [s].
        x: Position of the probe [m or rad].
        force: That the virtual environment asks for [N or N m].

    Raises:
        ParameterError: If a number is not finite, time goes back, or the step is too long for the velocity's filter.
    """
    require_not_negative(time_step=dt)
    require_numbers(position_of_the_probe=x, force=force)
    _require_rate(axis, dt)
    state, out = state.copy(), np.zeros((1, COLUMNS))
    along(axis_numbers(axis), state, np.array([dt]), np.array([x]), np.array([force]), out)
    return state, float(out[0, FORCE])


def rendered(axis: CheapAxis, t: Float[Array, " N"], x: Float[Array, " N"], force: Float[Array, " N"]) -> Rendered:
    """What a hand feels that moves the probe along ``x``.

    Args:
        axis: What is cheap.
        t: Sample times [s], of any spacing that has the velocity's cut-off below half the rate (7 ms at 70 Hz).
        x: Positions of the probe [m or rad].
        force: That the virtual environment asks for [N or N m].

    Raises:
        ParameterError: If there is no sample, a column has another length or holds no number, or times do not increase
            or lie too far apart for the velocity's filter.
    """
    if np.ndim(t) != 1 or len(t) == 0:
        raise ParameterError(
            f"Sample times of shape {np.shape(t)} were given: give one for each of one or more samples."
        )
    require_columns(len(t), sample_times=t, position_of_the_probe=x, force=force)
    steps = np.diff(t, prepend=t[:1])
    if not (steps[1:] > 0).all():
        raise ParameterError("The sample times do not increase: give each sample a time later than the last.")
    _require_rate(axis, float(steps.max()))
    out = np.zeros((len(t), COLUMNS))
    x, force = (np.ascontiguousarray(values, dtype=float) for values in (x, force))
    along(axis_numbers(axis), at_rest(), steps, x, force, out)
    return Rendered(
        force=out[:, FORCE],
        coupling=out[:, COUPLING],
        mass_position=out[:, X],
        mass_velocity=out[:, V],
        velocity=out[:, PROBE_SPEED],
        contact=out[:, SIDE] != 0,
        stuck=out[:, STICKS] != 0,
    )


def rendered_axes(
    axes: tuple[CheapAxis, ...], t: Float[Array, " N"], q: Float[Array, "N n"], force: Float[Array, "N n"]
) -> Float[Array, "N n"]:
    """Forces [N or N m] on the hand of a device with several motors, each with a model of its own; see `rendered`.

    Raises:
        ParameterError: If the axes are not as many as the columns, or the times are refused.
    """
    if not axes or np.shape(q) != (len(t), len(axes)) or np.shape(force) != (len(t), len(axes)):
        raise ParameterError(
            f"There are {len(t)} times, {len(axes)} axes, and positions and forces of the shapes {np.shape(q)} and "
            f"{np.shape(force)}: give one or more axes, and for each sample as many positions and forces."
        )
    return np.column_stack([rendered(axis, t, q[:, k], force[:, k]).force for k, axis in enumerate(axes)])


def _require_rate(axis: CheapAxis, longest: float) -> None:
    if np.isfinite(axis.cutoff_hz) and not longest < 0.5 / axis.cutoff_hz:
        raise ParameterError(
            f"Samples are up to {1e3 * longest:.3g} ms apart and the velocity is filtered at {axis.cutoff_hz:g} "
            f"Hz: give more than {2 * axis.cutoff_hz:g} samples a second."
        )
