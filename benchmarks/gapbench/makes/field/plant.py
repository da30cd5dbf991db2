"""What a true robot is made of beyond its links: drives, friction, springs, encoders, and what acts from outside."""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from .robots import Robot

Array = np.ndarray
ORDERS = 3  # most cycles that a cogging torque is made of


class Plant(NamedTuple):
    """Numbers of the stepping loop, one a joint unless said otherwise, shape ``(n,)``; zero (or one) means absent.

    Attributes:
        forth: Dry friction at positive speed [N m or N]; ``back`` at negative speed.
        static: What standing still adds to it; ``slide``: the speed within which that is lost.
        damp_forth: Viscous coefficient at positive speed; ``damp_back`` at negative speed.
        loaded: Dry friction over the torque that passes the transmission.
        bristle: Torque at which presliding saturates; ``reach``: its displacement at the initial stiffness.
        rotor: Rotor inertia on the joint's side.
        stiff: Stiffness between motor and link, 0 is rigid; ``gap``: full width of the play between them.
        limit: Largest torque of the drive.
        ratio: True torque over logged torque; ``offset`` is added.
        delay: Of the drive [s]; ``lag``: its time constant [s].
        spring: Stiffness of a spring beside the joint; ``rest``: where it is free.
        orders: Cycles a revolution of a cogging torque, shape ``(n, 3)``, with ``heights`` and ``phases``.
        shift: Added to the encoder's reading.
        wave: Amplitude of the encoder's periodic error, with ``wave_order`` and ``wave_phase``.
        couple: First joint (or -1), second joint, ratio, Coulomb torque, coefficient, inertia, shape ``(6,)``.
        warm: Share of the dry friction that goes as the drive warms up, with ``warm_time`` [s], shape ``(1,)``.
        sag: Share of the torque lost while the sum of all torques is twice its mean, shape ``(1,)``.
        ripple: Share of the torque that goes and comes with ``ripple_order`` cycles a revolution.
        wall: Stiffness of an elastic stop; ``wall_at``: where it begins; ``wall_side``: +1 above, -1 below.
        drag: Dry friction that grows with the way beyond ``drag_at`` [N m/rad].
    """

    forth: Array
    back: Array
    static: Array
    slide: Array
    damp_forth: Array
    damp_back: Array
    loaded: Array
    bristle: Array
    reach: Array
    rotor: Array
    stiff: Array
    gap: Array
    limit: Array
    ratio: Array
    offset: Array
    delay: Array
    lag: Array
    spring: Array
    rest: Array
    orders: Array
    heights: Array
    phases: Array
    shift: Array
    wave: Array
    wave_order: Array
    wave_phase: Array
    couple: Array
    warm: Array
    warm_time: Array
    sag: Array
    ripple: Array
    ripple_order: Array
    wall: Array
    wall_at: Array
    wall_side: Array
    drag: Array
    drag_at: Array


def sound_plant(robot: Robot) -> Plant:
    """The true robot without any effect."""
    n = robot.true.n
    zero, one, cycles = np.zeros(n), np.ones(n), np.zeros((n, ORDERS))
    plain = {
        name: zero.copy() for name in Plant._fields if name not in ("orders", "heights", "phases", "couple", "sag")
    }
    return Plant(
        **{
            **plain,
            "orders": cycles,
            "heights": cycles.copy(),
            "phases": cycles.copy(),
            "couple": np.array([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
            "sag": np.zeros(1),
            "warm_time": np.ones(1),
            "forth": robot.true_coulomb.copy(),
            "back": robot.true_coulomb.copy(),
            "static": robot.true_coulomb * robot.static,
            "slide": robot.slide.copy(),
            "damp_forth": robot.true_viscous.copy(),
            "damp_back": robot.true_viscous.copy(),
            "reach": one.copy(),
            "rotor": robot.true_rotor.copy(),
            "limit": np.full(n, np.inf),
            "ratio": one.copy(),
            "wave_order": one.copy(),
        }
    )


def put(plant: Plant, joint: int, **values: float) -> Plant:
    """The plant with some numbers of one joint replaced."""
    fields = {}
    for name, value in values.items():
        fields[name] = getattr(plant, name).copy()
        fields[name][joint] = value
    return plant._replace(**fields)


def add(plant: Plant, joint: int, **values: float) -> Plant:
    """The plant with something added to some numbers of one joint."""
    return put(plant, joint, **{name: getattr(plant, name)[joint] + value for name, value in values.items()})


CYCLES = ("orders", "heights", "phases")
WHOLE = ("couple", "warm_time", "sag")  # of the whole robot, not of a joint
_SINGLE = tuple(name for name in Plant._fields if name not in (*CYCLES, *WHOLE))
Row = namedtuple("Row", (*_SINGLE, *CYCLES))
ROW = Row(*range(len(_SINGLE)), *(len(_SINGLE) + ORDERS * i for i in range(len(CYCLES))))


def rows_of(plant: Plant) -> tuple[Array, Array]:
    """The numbers of all joints as one array, whose rows `ROW` names, and those of the whole robot as another.

    Compiled functions count who holds each array they are given: one is taken several times as fast as forty.
    """
    single = [getattr(plant, name)[None] for name in _SINGLE]
    cycles = [getattr(plant, name).T for name in CYCLES]
    return np.concatenate([*single, *cycles]), np.concatenate([getattr(plant, name) for name in WHOLE])
