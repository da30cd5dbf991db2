"""Torque ripple that grows with the load: ``tl * sum of A sin(n q + p)``, in cycles ``n`` per joint revolution.

The torque of a motor whose poles are not sinusoidal, or of a gear whose teeth do not mesh evenly, is a share too high
at some angles and too low at others; ``tl`` is the torque that the transmission passes. It leaves waves over position
that are as high as the load and change sign with it, where those of a cogging torque are the same at any load: several
loads at one place separate them. Where the load follows the position alone, as that of a slow joint in gravity does,
a ripple of order n is two cogging waves, of n - 1 and n + 1. The load is that of the model, not the measured one,
whose noise would bias the fit. It is looked for where a wave as high as the load stands out in the residual.
On a linear joint ``n`` is in radians per metre. URDF and MJCF have no place for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.effects.effect import Effect, Parameter, Shape, Signature
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Law, Moment, Simulated
from phantom_dyn.effects.support.cogging_orders import comes_back, order_range, orders_in, slowest_order
from phantom_dyn.effects.support.rows import row_of, torque_on_joint
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Periods in a turn of the joint (rad/m of a linear one): more than a hundred pole pairs behind a gear of a thousand.
_MOST_TURNS = 1e5
# Share of the load that a drive or gear may ripple by.
_LARGEST = 0.5
# Of the filter that the load goes through, forth and back.
_POLES = 4


class TorqueRipple(Effect):
    """See the module."""

    name = "torque_ripple"
    regime = "periodic_in_angle"
    shape_held = True
    takes_lists = True
    uses_acceleration = True
    follows_model = True
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
        """Lists of equal length; ``theta`` is all orders, then all amplitudes, then all phases."""
        return (
            Parameter(
                "order",
                "rad/m" if robot.prismatic[row_of(robot, joint)] else "1",
                0.0,
                plausible=(0.0, _MOST_TURNS),
                plausible_because="slots, poles and teeth times a gear ratio are fewer",
            ),
            Parameter(
                "amplitude",
                "1",
                0.0,
                plausible=(0.0, _LARGEST),
                plausible_because="a drive whose torque swings by half of itself each period turns by jerks",
            ),
            Parameter(
                "phase",
                "rad",
                -np.pi,
                np.pi,
                plausible=(-np.pi, np.pi),
                plausible_because="a wave may begin anywhere",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Sets of one to so many orders as stand out in the residual torque over position, weighted by the load.

        None where none stands out.
        """
        row = row_of(robot, joint)
        # A joint that moves nothing has no load.
        if not operation.transmitted[:, row].any():
            return ()
        whole = not robot.prismatic[row]
        # What other findings made of it may be the ripple's.
        there = replace(operation, residual_of_fit=operation.residual + operation.expected - operation.tau)
        found = orders_in(there, row, whole_numbers=whole, load=operation.transmitted[:, row])
        kept = (tuple(order for order in orders if comes_back(operation, row, order)) for orders in found)
        return tuple(dict.fromkeys(orders for orders in kept if orders))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Minus sine and cosine of every order times the load: the drive cancels them."""
        row = row_of(robot, joint)
        q, load = operation.q[:, row], _smooth_load(operation, row)
        columns = -np.stack([load * wave(n * q) for n in shape for wave in (np.sin, np.cos)], axis=-1)[:, None, :]
        names = tuple(f"{wave}_{k + 1}" for k in range(len(shape)) for wave in ("sine", "cosine"))
        return Signature((row,), columns, names, ("1",) * len(names), columns)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Orders, amplitudes and phases."""
        sine, cosine = coefficients[0::2], coefficients[1::2]
        return np.concatenate([shape, np.hypot(sine, cosine), np.arctan2(cosine, sine)])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Amplitude of the strongest order."""
        return "amplitude", np.array([1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Some wave has to turn ten times, and three of them slowly enough for the judged band."""
        row = row_of(robot, joint)
        low, high = order_range(operation, row)
        if low >= high:
            return f"{joint} travels less than one period of any ripple that its sampling rate can show"
        if slowest_order(operation, row) is None:
            return (
                f"no ripple of {joint} turns ten times, three of them where the joint is slow enough for it to lie in "
                "the judged band"
            )
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The law on the joint."""
        row = row_of(robot, joint)
        share = ripple(operation.q[:, row, None], *np.split(np.asarray(theta, dtype=float), 3))
        return torque_on_joint(robot, joint, operation.transmitted[:, row] * share)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The law at the true position with the load of the moment."""
        row = row_of(robot, joint)
        waves = np.reshape(np.asarray(theta, dtype=float), (3, -1))

        def torque(state: Array, dt: float, moment: Moment) -> tuple[Array, Array]:
            out = np.zeros(robot.nv)
            out[row] = moment.transmitted[row] * ripple(moment.q[row : row + 1, None], *waves).item()
            return state, out

        laws = tuple(Law(ripple_law, row, tuple(map(float, wave))) for wave in waves.T)
        return Simulated(torque=torque, laws=laws)


def _smooth_load(operation: Operation, row: int) -> Float[Array, " N"]:
    """Load, that of the links up to the edge of the judged band: above, waves would carry noise of accelerations."""
    load, edge = operation.transmitted[:, row], 2.0 * operation.band_hz * operation.dt
    if not 0.0 < edge < 1.0:
        return load
    # Friction steps where a joint reverses, and knows no acceleration.
    friction = operation.own_friction[:, row]
    return friction + np.asarray(sosfiltfilt(butter(_POLES, edge, output="sos"), load - friction))


def ripple(q: Float[Array, "N 1"], orders: Array, amplitudes: Array, phases: Array) -> Float[Array, " N"]:
    """Share of the load at positions [rad or m]; orders, amplitudes and phases have one entry each per wave."""
    return np.sin(q * orders + phases) @ amplitudes


@jit
def ripple_law(q: float, load: float, order: float, amplitude: float, phase: float) -> float:
    """One wave of the law under a transmitted torque ``load``."""
    return load * amplitude * np.sin(order * q + phase)
