"""Torque ripple that grows with the load: ``tl * sum of A sin(n q + p)``, in cycles ``n`` per joint revolution.

The load ``tl`` is the torque that the transmission passes. If the poles of a motor are not sinusoidal, or the teeth of
a gear are uneven, the torque is a few per cent too high at some angles and too low at others. The waves in the residual
are proportional to the load and change sign with the load; the waves of a cogging torque are the same at any load.
Several loads at one position separate the two. If the load depends on position only, as for a slow joint in gravity, a
ripple of order n equals two cogging waves of orders n - 1 and n + 1. The load is computed from the model, because noise
of a measured load would bias the fit. The effect is fitted only if such a wave is clearly visible in the residual.
On a linear joint ``n`` is in radians per metre. URDF and MJCF have no place for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    row_of,
    torque_law,
    torque_on_joint,
)
from phantom_dyn.effects.operation import up_to_band
from phantom_dyn.effects.support.position_waves import (
    comes_back,
    each_wave,
    orders_in,
    sines_and_cosines,
    unseen_waves,
    wave_numbers,
    wave_parameters,
    waves_at,
)

# Largest plausible ripple, as a share of the load.
_LARGEST = 0.5


class TorqueRipple(Effect):
    """Torque of one joint that varies with its position, in proportion to the load."""

    name = "torque_ripple"
    regime = "periodic_in_angle"
    fitted = "shape held"
    made_of = ("acceleration", "model")
    acts_as = "drive"
    words = EffectWords(
        name="torque ripple",
        meaning="torque that repeats with the joint angle and grows with the load",
        next_step="Record the same slow motion with two payloads over at least one period; then compensate it with a "
        "table over the angle that is multiplied by the load.",
        size="of {amplitude} times the load, {order} times a turn",
        parameters={
            "order": "periods in one turn of the joint",
            "amplitude": "largest torque of each order per torque that the transmission passes on",
            "phase": "phase of each order at joint angle zero",
        },
        shown_over=("phase",),
        lost="torque ripple that grows with load",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Order, amplitude and phase of each wave; ``theta`` holds all orders, then all amplitudes, then all phases."""
        amplitude = Parameter(
            "amplitude",
            "1",
            0.0,
            plausible=(0.0, _LARGEST),
            plausible_because="a drive whose torque swings by half of itself each period turns by jerks",
        )
        return wave_parameters(robot, joint, amplitude)

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Sets of the strongest orders in the residual torque over position, weighted by the load; may be empty."""
        row = row_of(robot, joint)
        # The transmission of a joint without links behind it passes no torque.
        if not operation.transmitted[:, row].any():
            return ()
        whole = not robot.prismatic[row]
        # Torque that other findings explain may be due to the ripple, so it is added to the residual.
        with_findings = replace(operation, residual_of_fit=operation.residual + operation.expected - operation.tau)
        found = orders_in(with_findings, row, whole_numbers=whole, load=operation.transmitted[:, row])
        kept = (tuple(order for order in orders if comes_back(operation, row, order)) for orders in found)
        return tuple(dict.fromkeys(orders for orders in kept if orders))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Minus sine and cosine of every order, times the load: the drive torque has to compensate the waves."""
        row = row_of(robot, joint)
        waves, names = sines_and_cosines(operation.q[:, row], shape)
        columns = -(up_to_band(operation, operation.transmitted[:, row])[:, None] * waves)[:, None, :]
        return Signature((row,), columns, names, ("1",) * len(names), columns)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Orders, amplitudes and phases from the coefficients of sines and cosines."""
        return wave_numbers(coefficients, shape)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: amplitude of the strongest order."""
        return "amplitude", np.array([1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the recording has too few periods of any wave, see `unseen_waves`."""
        return unseen_waves(operation, joint, "ripple")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Sum of all waves times the load."""
        row = row_of(robot, joint)
        return torque_on_joint(robot, joint, operation.transmitted[:, row] * waves_at(operation.q[:, row], theta))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """One compiled torque law for each wave."""
        row = row_of(robot, joint)
        return Simulated(laws=tuple(Law(ripple_law, row, wave) for wave in each_wave(theta)))


@torque_law
@jit
def ripple_law(q: float, load: float, order: float, amplitude: float, phase: float) -> float:
    """Torque of one wave under a transmitted torque ``load``."""
    return load * amplitude * np.sin(order * q + phase)
