"""The effects that can be added to a finished recording, each by its law, with one number for its strength.

An effect on the torque is added to the recorded torque: for the same motion, the drive of a robot with the effect needs
this additional torque. An effect on time or on an encoder changes the recorded columns. Effects that change the motion
(a torque limit, backlash, a spring in the transmission) are not included, because they would need a simulation.
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
