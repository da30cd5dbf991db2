"""Torques that are waves over the position of a joint: their numbers, their columns, and where no recording shows them.

The numbers are all orders, then all amplitudes, then all phases; an order counts periods in one turn of the joint, in
rad/m on a linear one. Cogging and ripple share them; see `cogging_orders` for how orders are found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape
from phantom_dyn.effects.support.cogging_orders import order_range, slowest_order
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.model.robot import Robot

# Periods in a turn of the joint (rad/m of a linear one): more than a hundred pole pairs behind a gear of a thousand.
_MOST_TURNS = 1e5


def wave_parameters(robot: Robot, joint: str | None, amplitude: Parameter) -> tuple[Parameter, ...]:
    """Lists of equal length: order, the amplitude that is given, phase."""
    order = Parameter(
        "order",
        "rad/m" if robot.prismatic[row_of(robot, joint)] else "1",
        0.0,
        plausible=(0.0, _MOST_TURNS),
        plausible_because="slots, poles and teeth times a gear ratio are fewer",
        listed=True,
    )
    phase = Parameter(
        "phase",
        "rad",
        -np.pi,
        np.pi,
        plausible=(-np.pi, np.pi),
        plausible_because="a wave may begin anywhere",
        listed=True,
    )
    return order, replace(amplitude, listed=True), phase


def sines_and_cosines(q: Float[Array, " N"], orders: Shape) -> tuple[Float[Array, "N m"], tuple[str, ...]]:
    """Sine and cosine of every order at positions, and their names."""
    waves = np.stack([wave(n * q) for n in orders for wave in (np.sin, np.cos)], axis=-1)
    return waves, tuple(f"{wave}_{k + 1}" for k in range(len(orders)) for wave in ("sine", "cosine"))


def wave_numbers(coefficients: Array, orders: Shape) -> Array:
    """Orders, amplitudes and phases of given coefficients of sines and cosines."""
    sine, cosine = coefficients[0::2], coefficients[1::2]
    return np.concatenate([orders, np.hypot(sine, cosine), np.arctan2(cosine, sine)])


def each_wave(theta: Array) -> list[tuple[float, float, float]]:
    """Order, amplitude and phase of each wave."""
    return [(float(n), float(a), float(p)) for n, a, p in np.reshape(np.asarray(theta, dtype=float), (3, -1)).T]


def waves_at(q: Float[Array, " N"], theta: Array) -> Float[Array, " N"]:
    """Sum of all waves at positions [rad or m]."""
    orders, amplitudes, phases = np.split(np.asarray(theta, dtype=float), 3)
    return sum_of_waves(q[:, None], orders, amplitudes, phases)


def sum_of_waves(q, orders, amplitudes, phases):
    """The same at one position, or at many, shape ``(N, 1)``; kernels compile it for one.

    Args:
        q: Position [rad or m].
        orders: Cycles per revolution (rad/m on a linear joint), shape ``(k,)``.
        amplitudes: Largest values, shape ``(k,)``.
        phases: Phases [rad], shape ``(k,)``.
    """
    return np.dot(np.sin(q * orders + phases), amplitudes)


def unseen_waves(operation: Operation, joint: str | None, name: str) -> str | None:
    """Why a recording shows no wave of a joint, in words; None where it may.

    Some wave has to turn five times, and three of them slowly enough for the judged band.

    Args:
        operation: The recording.
        joint: Its joint.
        name: Of the effect in words.
    """
    row = row_of(operation.robot, joint)
    low, high = order_range(operation, row)
    if low >= high:
        return f"{joint} travels less than one period of any {name} that its sampling rate can show"
    if slowest_order(operation, row) is None:
        return (
            f"no {name} of {joint} turns five times, three of them where the joint is slow enough for it to lie in the "
            "judged band"
        )
    return None
