r"""Fits the stiffness of a transmission to hysteresis loops of a blocked arm, which are simulated or recorded.

Arm and forearm are held rigidly, the motor torque is a triangular wave, and the motor's position is measured:
:math:`\Gamma = K\,dq + B\,d\dot q + \mathrm{offset}`, equations (13) and (14) of the CEA paper. Dry friction on the
motor's side makes the loop wider by twice the friction torque. The paper has no term for dry friction; here it is an
additional unknown. Loops of a single rate cannot separate dry friction from damping: record several rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.data.derivatives import differentiate
from identification.data.recording import Recording
from identification.data.signals import uniform
from identification.excitation.motion_shapes import Triangle
from identification.experiments.linear_fit import LinearFit, fit_linear
from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import LogError, ParameterError

_STUCK = 0.5  # below this share of the loop's median speed the motor may stick, and its friction torque is unknown
# Edge of the low pass, in multiples of the triangle's frequency; higher harmonics only sharpen the corners.
_HARMONICS = 20.0
_SHARE_OF_RATE = 0.2  # largest edge of the low pass, as a share of the sample rate


@dataclass(frozen=True)
class Loop(ReadOnlyArrays):
    """A hysteresis loop: motor torque and motor position of a blocked arm.

    Attributes:
        t: Time [s], in equal steps, shape ``(N,)``.
        torque: Torque of the motor, on the joint side [N m], shape ``(N,)``.
        position: Position of the motor, on the joint side [rad], shape ``(N,)``.
    """

    t: Float[Array, " N"]
    torque: Float[Array, " N"]
    position: Float[Array, " N"]


def triangular_torque(t: Float[Array, " N"], amplitude: float, frequency: float) -> Float[Array, " N"]:
    """Triangular torque [N m] between ``-amplitude`` and ``amplitude``, with rounded corners.

    Args:
        t: Time [s].
        amplitude: Largest torque [N m].
        frequency: Frequency of the triangle [Hz].
    """
    return Triangle(amplitude, frequency, turn=0.02).motion(t)[0]


def blocked_arm_loop(
    t: Float[Array, " N"], torque: Float[Array, " N"], *, stiffness: float, damping: float, coulomb: float
) -> Loop:
    """Simulated motion of a motor against a blocked arm, without inertia, from rest at zero.

    The integration is implicit Euler. With ``damping = 0`` the result is exact: the motor does not move until its
    torque differs from the spring's torque by more than ``coulomb``.

    Args:
        t: Time [s], in equal steps.
        torque: Torque of the motor, on the joint side [N m].
        stiffness: Stiffness of the transmission [N m/rad].
        damping: Damping of the transmission [N m s/rad].
        coulomb: Dry friction on the motor's side [N m].

    Raises:
        ParameterError: If the stiffness is not positive, or damping or friction is negative.
    """
    if not (stiffness > 0 and damping >= 0 and coulomb >= 0):
        raise ParameterError(
            f"A blocked arm of stiffness {stiffness:g}, damping {damping:g} and friction {coulomb:g} was asked for: "
            "give a positive stiffness and no negative damping or friction."
        )
    resistance = damping / (t[1] - t[0]) if len(t) > 1 else 0.0
    position = np.empty_like(torque)
    q = 0.0
    for k, given in enumerate(torque):
        excess = given - stiffness * q
        q += np.sign(excess) * max(abs(excess) - coulomb, 0.0) / (resistance + stiffness)
        position[k] = q
    return Loop(t, torque, position)


def fit_transmission(loops: Sequence[Loop], *, cutoff_hz: float) -> LinearFit:
    """Stiffness K, damping B, dry friction C and offset of a transmission from its hysteresis loops.

    Samples near the reversals are left out, because the motor sticks there with an unknown friction torque.

    Args:
        loops: Hysteresis loops at several rates; a single rate hardly separates B and C.
        cutoff_hz: Edge of the low pass of positions before they are differentiated [Hz].

    Returns:
        Unknowns ``K`` [N m/rad], ``B`` [N m s/rad], ``C`` [N m] and ``offset`` [N m].

    Raises:
        LogError: If the motor does not move in a loop.
        IdentifiabilityError: If the motor moves in one direction only.
    """
    parts = [_equations(loop, cutoff_hz) for loop in loops]
    W, torque = np.concatenate([W for W, _ in parts]), np.concatenate([y for _, y in parts])
    return fit_linear(W, torque, ("K", "B", "C", "offset"), ("N m/rad", "N m s/rad", "N m", "N m"))


def _equations(loop: Loop, cutoff_hz: float) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Columns (position, velocity, its sign, one) and torque [N m], at samples of a loop in which the motor moves."""
    if np.ptp(loop.position) == 0:
        raise LogError("The motor does not move against the blocked arm: give more torque than its dry friction.")
    rate = (len(loop.t) - 1) / (loop.t[-1] - loop.t[0])
    q, v, _ = (column[:, 0] for column in differentiate(loop.position[:, None], rate, cutoff_hz))
    moving = np.abs(v) > _STUCK * np.median(np.abs(v))
    # The filter blurs the start and end of a stop over a quarter of its period. These samples are left out, too.
    reach = int(np.ceil(0.25 * rate / cutoff_hz))
    stuck = np.convolve(~moving, np.ones(2 * reach + 1), mode="same") > 0.5
    return np.stack([q, v, np.sign(v), np.ones_like(q)], axis=1)[~stuck], loop.torque[~stuck]


def loop_of(recording: Recording, joint: str) -> Loop:
    """Torque and motor position of one joint of a recording.

    Raises:
        LogError: If the recording has no torque, or has gaps.
    """
    t, q, tau, valid = uniform(recording)
    if not valid.all():
        raise LogError(f"{recording.file} has gaps: record the loop in one piece, or cut the file at them.")
    k = recording.joint_names.index(joint)
    return Loop(t, tau[:, k], q[:, k])


def cutoff_of(loops: tuple[Loop, ...]) -> float:
    """Edge of the low pass of positions [Hz]: the largest edge of any loop.

    The edge of a loop is twenty times the frequency of its torque, but at most a fifth of its sample rate.
    """
    edges = []
    for loop in loops:
        rate = (len(loop.t) - 1) / (loop.t[-1] - loop.t[0])
        power = np.abs(np.fft.rfft(loop.torque - loop.torque.mean())) ** 2
        main = float(np.argmax(power)) * rate / len(loop.t)
        edges.append(min(_HARMONICS * max(main, 1.0 / (loop.t[-1] - loop.t[0])), _SHARE_OF_RATE * rate))
    return max(edges)


def moving_joint(recordings: tuple[Recording, ...]) -> str:
    """Name of the joint whose torque varies most in all recordings: its motor pushed against the blocked arm.

    Raises:
        LogError: If a recording has no torque, or no torque changes in any of them.
    """
    swing = np.zeros(len(recordings[0].joint_names))
    for recording in recordings:
        if recording.tau is None:
            raise LogError(f"{recording.file} has no torque: record the motor's torque, or its current with a map.")
        swing += recording.tau.std(axis=0)
    if not swing.max() > 0:
        raise LogError(f"{recordings[0].file}: no torque changes; let one motor push and pull against the held arm.")
    return recordings[0].joint_names[int(np.argmax(swing))]
