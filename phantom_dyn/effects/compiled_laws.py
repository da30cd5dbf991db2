"""The compiled laws of the catalogue: one list a channel, and the functions that call a law by its place in the list.

An effect whose laws are not listed here is stepped in Python, and every effect beside it: a law is worth a line here
where simulations with it have to be fast. Scalars in and out: a law that took an array would cost more than its
numbers, for counting who holds the array.

Numba does not see that a function which calls these must be compiled anew after a change of an effect's law: delete
the ``__pycache__`` of this folder and of `phantom_dyn.simulation.compiled` then.
"""

from __future__ import annotations

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.drive.actuator_lag import lag_law
from phantom_dyn.effects.drive.cogging import wave_law
from phantom_dyn.effects.drive.input_delay import delay_law
from phantom_dyn.effects.drive.torque_constant import scaled_law
from phantom_dyn.effects.drive.torque_offset import constant_law
from phantom_dyn.effects.drive.torque_ripple import ripple_law
from phantom_dyn.effects.drive.torque_saturation import clipped_law
from phantom_dyn.effects.encoder.encoder_eccentricity import eccentric_law
from phantom_dyn.effects.encoder.encoder_offset import shifted_law
from phantom_dyn.effects.encoder.encoder_quantization import rounded_law
from phantom_dyn.effects.friction.direction_dependent_friction import two_way_law
from phantom_dyn.effects.friction.joint_coupling import shared_law
from phantom_dyn.effects.friction.load_dependent_friction import loaded_law
from phantom_dyn.effects.friction.position_dependent_friction import bent_law
from phantom_dyn.effects.friction.presliding_friction import bristle_law, stick_law
from phantom_dyn.effects.friction.stribeck_friction import falling_law
from phantom_dyn.effects.transmission.parasitic_spring import spring_law

TORQUES = (
    two_way_law,
    falling_law,
    constant_law,
    spring_law,
    bristle_law,
    stick_law,
    loaded_law,
    shared_law,
    wave_law,
    ripple_law,
    bent_law,
)
COMMANDS = (scaled_law, clipped_law, delay_law, lag_law)
READINGS = (shifted_law, eccentric_law, rounded_law)
# The one law with a memory too long for scalars: kernels call it themselves.
DELAY = COMMANDS.index(delay_law)


@jit
def torque_of(
    code: int,
    p0: float,
    p1: float,
    p2: float,
    p3: float,
    s0: float,
    s1: float,
    s2: float,
    q: float,
    v: float,
    load: float,
) -> tuple[float, float, float, float]:
    """State and torque of the law ``code`` with parameters ``p`` and state ``s``."""
    if code == 0:
        return s0, s1, s2, two_way_law(v, p0, p1, p2)
    if code == 1:
        return s0, s1, s2, falling_law(v, p0, p1)
    if code == 2:
        return s0, s1, s2, constant_law(p0)
    if code == 3:
        return s0, s1, s2, spring_law(q, p0, p1)
    if code == 4:
        z, torque = bristle_law(s0, s1, q, p0, p1)
        return q, z, s2, torque
    if code == 5:
        stuck, anchor, torque = stick_law(s0, s1, s2, q, v, p0, p1, p2, p3)
        return q, stuck, anchor, torque
    if code == 6:
        return s0, s1, s2, loaded_law(v, load, p0)
    if code == 7:
        return s0, s1, s2, shared_law(v, p0, p1)
    if code == 8:
        return s0, s1, s2, wave_law(q, p0, p1, p2)
    if code == 9:
        return s0, s1, s2, ripple_law(q, load, p0, p1, p2)
    return s0, s1, s2, bent_law(q, v, p0, p1, p2)


@jit
def command_of(code: int, p0: float, s0: float, dt: float, tau: float) -> tuple[float, float]:
    """State and torque that the drive gives when ``tau`` is asked for, by any law but that of a delay."""
    if code == 0:
        return s0, scaled_law(tau, p0)
    if code == 1:
        return s0, clipped_law(tau, p0)
    return lag_law(s0, tau, dt, p0)


@jit
def reading_of(code: int, p0: float, p1: float, p2: float, q: float) -> float:
    """Reading of an encoder at position ``q``."""
    if code == 0:
        return shifted_law(q, p0)
    if code == 1:
        return eccentric_law(q, p0, p1, p2)
    return rounded_law(q, p0)
