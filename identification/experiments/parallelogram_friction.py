r"""Separates the friction of a parallelogram's active and passive joints by three tests at constant speeds.

The friction of the passive joints acts on the motors of joints 2 and 5, equations (16) and (17) of the CEA paper:

.. math::
    \Gamma_{t2} &= F_{V2} v_2 + F_{C2}\,\mathrm{sign}\,v_2 + \Gamma_{fc}, \\
    \Gamma_{t5} &= F_{V5R} v_5 + F_{C5R}\,\mathrm{sign}\,v_5 - \Gamma_{fc}, \\
    \Gamma_{fc} &= F_{V3R} (v_2 - v_5) + F_{C3R}\,\mathrm{sign}(v_2 - v_5).

Joint 4 turns at -v5; its friction is regrouped with that of joint 5 (5R). Joints 3, 6 and the cut joint 7 turn at plus
or minus v5 - v2; their friction is regrouped, too (3R).

- Test t1 (v5 = v2) gives the friction of joint 2 and of joint 5, without the passive joints.
- Test t2 (v5 = 0) gives the friction of joint 2 plus the passive joints.
- Test t3 (v2 = 0) gives the friction of joint 5 plus the passive joints.

The differences t2 - t1 and t3 - t1 are the friction of the passive joints. (The text of the paper once names the
results of t3 ``F_V5t2`` and ``F_C5t2``, and its table has ``F_V5t3`` twice: the second one is ``FC5t3``.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identification.excitation.motion_shapes import Triangle
from identification.experiments.constant_speed_friction import fit_steady
from identification.experiments.linear_fit import LinearFit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.motion import Motion

_AMPLITUDE = 0.4  # amplitude of a friction test [rad]
_CENTER = (0.0, -0.26, -1.83)  # centre of q1, q2, q5 in a friction test [rad]
_RATE_HZ = 500.0

MOVING: Mapping[str, tuple[int, ...]] = {"t1": (1, 2), "t2": (1,), "t3": (2,)}
"""Indices of the active joints (q1, q2, q5) that move in each test, and whose torques are used."""

_STILL = 0.1  # below this share of the largest speed a joint counts as not moving


@dataclass(frozen=True)
class Friction:
    """Viscous coefficient [N m s/rad] and Coulomb torque [N m] of one joint, or of several regrouped joints."""

    viscous: float = 0.0
    coulomb: float = 0.0

    def torque(self, v: Float[Array, " N"]) -> Float[Array, " N"]:
        """Drive torque at velocities ``v`` [N m], (15), with ``sign(0) = 0``."""
        return self.viscous * v + self.coulomb * np.sign(v)


def loop_friction(
    v2: Float[Array, " N"], v5: Float[Array, " N"], *, arm: Friction, forearm: Friction, passive: Friction
) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
    """Drive torque of joints 2 and 5 against friction [N m], (16) and (17).

    Args:
        v2: Velocity of joint 2 [rad/s].
        v5: Velocity of joint 5 [rad/s].
        arm: Friction of joint 2.
        forearm: Friction of joints 5 and 4 (5R).
        passive: Friction of joints 3, 6 and 7 (3R).
    """
    coupling = passive.torque(v2 - v5)
    return arm.torque(v2) + coupling, forearm.torque(v5) - coupling


def friction_test_motion(
    test: str,
    *,
    speeds: Sequence[float] = (0.1, 0.2, 0.4, 0.8),
) -> Motion:
    """Motion of a friction test: the joints of the test move in triangles, two periods at each speed.

    Args:
        test: Name of the test: ``t1``, ``t2`` or ``t3``.
        speeds: Approximate speeds of the straight parts [rad/s]; the rounded corners take a tenth of the time.

    Raises:
        ParameterError: If the test is unknown.
    """
    moving = _moving(test)
    parts = []
    for speed in speeds:
        frequency = speed / (4 * _AMPLITUDE)
        t = np.arange(round(2 / frequency * _RATE_HZ)) / _RATE_HZ
        parts.append(Triangle(_AMPLITUDE, frequency).motion(t))
    wave = np.concatenate(parts, axis=1)
    motion = np.zeros((*wave.shape, 3))
    motion[:, :, list(moving)] = wave[:, :, None]
    q, v, a = (motion[k] for k in range(3))
    return Motion(np.arange(wave.shape[1]) / _RATE_HZ, q + np.array(_CENTER), v, a)


def fit_friction_test(test: str, motion: Motion, tau: Float[Array, "N 3"]) -> dict[int, LinearFit]:
    """Viscous and Coulomb friction of each joint that moves in a test.

    A single speed hardly separates the two unknowns: a test needs several.

    Args:
        test: Name of the test: ``t1``, ``t2`` or ``t3``.
        motion: Motion of q1, q2, q5.
        tau: Drive torque of q1, q2, q5 [N m].

    Returns:
        Fit by index of the joint (1 is q2, 2 is q5), with unknowns named as in Table 3, such as ``FV2t1``.

    Raises:
        ParameterError: If the test is unknown.
        LogError: If a joint of the test never has a constant speed.
    """
    return {joint: _fit_joint(test, joint, motion, tau[:, joint]) for joint in _moving(test)}


def passive_friction(tests: Mapping[str, Mapping[int, LinearFit]]) -> dict[str, tuple[float, float]]:
    """Friction of the passive joints and its standard deviation, from the differences between the tests.

    Args:
        tests: Results of t1, t2 and t3.

    Returns:
        ``FV3R`` [N m s/rad] and ``FC3R`` [N m], each the weighted mean of t2 - t1 on joint 2 and t3 - t1 on joint 5.
    """
    out = {}
    for kind in ("FV", "FC"):
        with_passive = [tests["t2"][1].value(f"{kind}2t2"), tests["t3"][2].value(f"{kind}5t3")]
        without = [tests["t1"][1].value(f"{kind}2t1"), tests["t1"][2].value(f"{kind}5t1")]
        pairs = list(zip(with_passive, without, strict=True))
        difference = np.array([more[0] - less[0] for more, less in pairs])
        weight = np.array([1 / (more[1] ** 2 + less[1] ** 2) for more, less in pairs])
        out[f"{kind}3R"] = (float(weight @ difference / weight.sum()), float(weight.sum() ** -0.5))
    return out


def _moving(test: str) -> tuple[int, ...]:
    """Indices of the joints that move in a test, after a check of its name."""
    if test not in MOVING:
        raise ParameterError(f"There is no friction test {test!r}: take one of {', '.join(MOVING)}.")
    return MOVING[test]


def _fit_joint(test: str, joint: int, motion: Motion, tau: Array) -> LinearFit:
    """Viscous and Coulomb friction of one joint in a test, named as in Table 3."""
    name = f"{2 if joint == 1 else 5}{test}"
    try:
        names, units = (f"FV{name}", f"FC{name}"), ("N m s/rad", "N m")
        return fit_steady(motion.q[:, joint], motion.v[:, joint], motion.a[:, joint], tau, names, units)[0]
    except LogError as error:
        raise LogError(f"Joint {name[0]} in test {test}: {error}") from error


def test_of(motion: Motion) -> str:
    """Name of the friction test in which the same joints move as in a recording.

    Raises:
        LogError: If the motion is that of no test.
    """
    v2, v5 = motion.v[:, 1], motion.v[:, 2]
    size = max(float(np.std(v2)), float(np.std(v5)), 1e-12)
    moves = [float(np.std(x)) > _STILL * size for x in (v2, v5, v2 - v5)]
    for test, expected in (("t1", [True, True, False]), ("t2", [True, False, True]), ("t3", [False, True, True])):
        if moves == expected:
            return test
    raise LogError(
        "q2 and q5 move, but neither together nor one alone: record q2 and q5 at one speed (t1), q2 alone (t2) and "
        "q5 alone (t3)."
    )
