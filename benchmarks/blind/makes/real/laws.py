"""The effects that a recording can be given after the fact, each from its law, with one number for its strength.

What acts on the torque is put into the recorded torque: the drive of a robot that has the effect and makes the same
motion needs so much more. What acts on time or on an encoder changes the columns. Effects that change the motion
(a limit of the torque, play, a spring in the transmission) would need a simulation of both robots and are left out.
"""

from __future__ import annotations

from benchmarks.blind.makes.real.body_and_encoder_laws import (
    coarse,
    eccentricity,
    encoder_offset,
    inertias,
    payload,
    spring,
    tilt,
)
from benchmarks.blind.makes.real.drive_laws import (
    actuator_lag,
    cogging,
    input_delay,
    rotor,
    torque_constant,
    torque_offset,
)
from benchmarks.blind.makes.real.friction_laws import (
    by_direction,
    coulomb,
    coupling,
    loaded,
    presliding,
    stribeck,
    viscous,
)
from benchmarks.blind.makes.real.scene import Law

EFFECTS: tuple[Law, ...] = (
    viscous,
    coulomb,
    by_direction,
    stribeck,
    presliding,
    loaded,
    coupling,
    cogging,
    torque_constant,
    torque_offset,
    input_delay,
    actuator_lag,
    rotor,
    payload,
    inertias,
    tilt,
    spring,
    encoder_offset,
    eccentricity,
    coarse,
)
