"""Torque that is periodic in the joint's position: ``sum of A sin(n q + p)``, in cycles ``n`` per joint revolution.

At one position the torque is the same in both directions and at any speed. Friction ripple changes its sign with the
direction, and an eccentric encoder adds a torque that grows with the square of speed: motion at several speeds over at
least one period separates them. On a prismatic joint ``n`` is in radians per metre. If a joint travels less than one
period of a wave, the wave is not searched, because it cannot be separated from gravity or a spring.
MJCF: a ``dcmotor`` with ``cogging`` for each wave, from MuJoCo 4.0; URDF has no place for it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.support.position_waves import (
    comes_back,
    each_wave,
    orders_in,
    sines_and_cosines,
    slowest_order,
    unseen_waves,
    wave_numbers,
    wave_parameters,
    waves_at,
)
from phantom_dyn.effects.support.rows import stated_limit


class Cogging(Effect):
    """Torque of one joint that is periodic in its position."""

    name = "cogging"
    regime = "periodic_in_angle"
    acts_as = "drive"
    fitted = "shape held"
    words = EffectWords(
        name="cogging",
        meaning="torque that repeats with the joint angle, the same at every speed",
        next_step="Record at several slow speeds over at least one period, then compensate it with a table over the "
        "angle.",
        size="of {amplitude}, {order} times a turn",
        parameters={
            "order": "periods in one turn of the joint",
            "amplitude": "largest torque of each order",
            "phase": "phase of each order at joint angle zero",
        },
        shown_over=("phase",),
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Order, amplitude and phase of each wave; ``theta`` holds all orders, then all amplitudes, then all phases."""
        amplitude = Parameter(
            "amplitude",
            torque_unit(robot, joint),
            0.0,
            plausible=(0.0, stated_limit(robot, joint)),
            plausible_because="a motor that cogs by more than it can give does not turn",
        )
        return wave_parameters(robot, joint, amplitude)

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Sets of orders to try: the strongest one in the residual torque over position, the two strongest, and so on.

        Orders with too few periods in the recording are left out.
        """
        row = row_of(robot, joint)
        found = orders_in(operation, row, whole_numbers=not robot.prismatic[row])
        kept = (tuple(order for order in orders if comes_back(operation, row, order)) for orders in found)
        sets = tuple(dict.fromkeys(orders for orders in kept if orders))
        # Without such an order, the limit of detection is computed for the lowest order that the recording could show.
        slowest = slowest_order(operation, row)
        return sets or (() if slowest is None else ((slowest,),))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Minus sine and cosine of every order: the drive torque has to compensate the waves."""
        row, unit = row_of(robot, joint), torque_unit(robot, joint)
        waves, names = sines_and_cosines(operation.q[:, row], shape)
        return Signature((row,), -waves[:, None, :], names, (unit,) * len(names))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Orders, amplitudes and phases from the coefficients of sines and cosines."""
        return wave_numbers(coefficients, shape)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: amplitude of the strongest order."""
        return "amplitude", np.array([1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the recording has too few periods of any wave, see `unseen_waves`."""
        return unseen_waves(operation, joint, "cogging")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Sum of the torques of all waves."""
        return torque_on_joint(robot, joint, waves_at(operation.q[:, row_of(robot, joint)], theta))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """One compiled torque law for each wave."""
        row = row_of(robot, joint)
        return Simulated(laws=tuple(Law(wave_law, row, wave) for wave in each_wave(theta)))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """All waves, which describe the effect completely."""
        return ModelNumbers(whole=True, waves=tuple(each_wave(theta)))


@torque_law
@inlined_jit
def wave_law(q: float, order: float, amplitude: float, phase: float) -> float:
    """Torque of one wave."""
    return amplitude * np.sin(order * q + phase)
