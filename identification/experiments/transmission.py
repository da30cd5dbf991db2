r"""Stiffness of a transmission: from the hysteresis loops of a blocked arm, and from a resonance in a recording.

Blocked arm: arm and forearm are held rigidly, the motor torque goes up and down in triangles, and the motor's position
is measured: :math:`\Gamma = K\,dq + B\,d\dot q + \mathrm{offset}`, equations (13) and (14) of the CEA paper. Dry
friction on the motor's side opens the loop by twice its torque; the paper has no term for it, and here it is an unknown
of its own. Loops of one rate cannot separate it from damping: record several.

Resonance: drive torque and motor position of one joint give an empirical transfer function, to which motor and link
inertia, transmission stiffness and damping of a two-mass model are fitted. Its stiffness is that of the effect
``transmission_compliance``, seen directly instead of through the model of the links. Wanted: a rich torque (noise, a
chirp) up to well above the resonance while the other joints hold still, and an encoder on the motor. Dry friction and
cogging lower the coherence; a joint that moves far changes its inertia with its posture, which a linear model cannot
follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identification.data.log import Log
from identification.data.signals import differentiate
from identification.excitation.motion_shapes import Triangle
from identification.experiments.linear_fit import LinearFit, fit_linear
from phantom_dyn.array_types import Float
from phantom_dyn.errors import LogError, ParameterError, RobotError
from phantom_dyn.haptics.experiments.white_noise import FrequencyResponse, estimate_frequency_response
from phantom_dyn.motion import read_only

if TYPE_CHECKING:
    from phantom_dyn.haptics.experiments.frequency_identification import TwoMassFit

Array = np.ndarray

_STUCK = 0.5  # of the loop's median speed: below it the motor is stuck or about to be, and friction takes any value

# A torque "at an instant" is known to a per cent up to this share of the rate.
_HIGHEST = 0.2
# Segments of a recording: as many as this at least, each this long at most [s].
_SEGMENTS = 12
_LONGEST = 8.0


@dataclass(frozen=True)
class Loop:
    """A hysteresis loop: torque up and down against a blocked arm.

    Attributes:
        t: Time [s], in equal steps, shape ``(N,)``.
        torque: Of the motor, on the joint side [N m], shape ``(N,)``.
        position: Of the motor, on the joint side [rad], shape ``(N,)``.
    """

    t: Float[Array, " N"]
    torque: Float[Array, " N"]
    position: Float[Array, " N"]

    def __post_init__(self):
        for name in ("t", "torque", "position"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def triangular_torque(t: Float[Array, " N"], amplitude: float, frequency: float) -> Float[Array, " N"]:
    """Torque [N m] that goes up and down between ``-amplitude`` and ``amplitude``, its corners rounded.

    Args:
        t: Time [s].
        amplitude: Largest torque [N m].
        frequency: Of the triangle [Hz].
    """
    return Triangle(amplitude, frequency, turn=0.02).motion(t)[0]


def blocked_arm_loop(
    t: Float[Array, " N"], torque: Float[Array, " N"], *, stiffness: float, damping: float, coulomb: float
) -> Loop:
    """What a motor does against a blocked arm, its inertia left out, from rest at zero.

    Between two samples the torque is that of the later one and the motor moves at one speed (implicit Euler), so that
    with ``damping = 0`` the result is exact: dry friction lets the torque play by ``coulomb`` to either side.

    Args:
        t: Time [s], in equal steps.
        torque: Of the motor, on the joint side [N m].
        stiffness: Of the transmission [N m/rad].
        damping: Of the transmission [N m s/rad].
        coulomb: Dry friction on the motor's side [N m].

    Raises:
        ParameterError: If the stiffness is not positive, or another is negative.
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

    Samples near the turns are left out: there the motor sticks, and friction takes whatever value holds it.

    Args:
        loops: Of several rates; of one rate, B and C come out with the deviations of quantities hardly separable.
        cutoff_hz: Positions are low-passed here before they are differentiated [Hz].

    Returns:
        Unknowns ``K`` [N m/rad], ``B`` [N m s/rad], ``C`` [N m] and ``offset`` [N m].

    Raises:
        LogError: If the motor does not move in a loop.
        IdentifiabilityError: If the motor moves in one direction only.
    """
    parts = [_equations(loop, cutoff_hz) for loop in loops]
    W, torque = np.concatenate([W for W, _ in parts]), np.concatenate([y for _, y in parts])
    return fit_linear(W, torque, ("K", "B", "C", "offset"), ("N m/rad", "N m s/rad", "N m", "N m"))


def _equations(loop: Loop, cutoff_hz: float) -> tuple[Array, Array]:
    if np.ptp(loop.position) == 0:
        raise LogError("The motor does not move against the blocked arm: give more torque than its dry friction.")
    rate = (len(loop.t) - 1) / (loop.t[-1] - loop.t[0])
    q, v, _ = (column[:, 0] for column in differentiate(loop.position[:, None], rate, cutoff_hz))
    moving = np.abs(v) > _STUCK * np.median(np.abs(v))
    # The filter smears the start and end of a stop over a quarter of its period: leave that out, too.
    reach = int(np.ceil(0.25 * rate / cutoff_hz))
    stuck = np.convolve(~moving, np.ones(2 * reach + 1), mode="same") > 0.5
    return np.stack([q, v, np.sign(v), np.ones_like(q)], axis=1)[~stuck], loop.torque[~stuck]


def joint_response(log: Log, joint: str, *, segment: float | None = None) -> FrequencyResponse:
    """Empirical transfer function of one joint, torque to position, up to a fifth of the sampling rate.

    Args:
        log: A recording in which this joint is driven by noise or a chirp.
        joint: Its name.
        segment: Length of the averaged segments [s]; a twelfth of the longest valid stretch, at most 8 s, by default.

    Raises:
        RobotError: If the recording has no such joint.
        LogError: If its longest valid stretch is under 256 samples, or its torque is constant.
    """
    if joint not in log.joint_names:
        raise RobotError(f"{log.file} has no joint {joint!r}: it has {', '.join(log.joint_names)}.")
    column = log.joint_names.index(joint)
    stretch = _longest_valid(log)
    count = stretch.stop - stretch.start
    if count < 256:
        raise LogError(f"{log.file}: the longest valid stretch has {count} samples: record 256 or more without a gap.")
    torque = log.tau[stretch, column]
    if np.ptp(torque) == 0:
        raise LogError(f"{log.file}: the torque of {joint} never changes: drive it with noise or a chirp.")
    t = log.motion.t
    period = float((t[-1] - t[0]) / (len(t) - 1))
    position = (log.motion.q if log.raw_q is None else log.raw_q)[stretch, column]
    length = min(count * period / _SEGMENTS, _LONGEST) if segment is None else segment
    response = estimate_frequency_response(torque, position, period=period, segment=length)
    return response.between(0.0, 2 * np.pi * _HIGHEST / period)


def transmission_resonance(log: Log, joint: str, *, segment: float | None = None) -> TwoMassFit:
    """Motor and link inertia, stiffness and dampings of one joint's transmission, with their covariance.

    `TwoMassFit.values` are those of `phantom_dyn.haptics.experiments.frequency_identification.NAMES`; the fifth is
    the stiffness. Arguments and errors are those of `joint_response`.

    Raises:
        EstimationError: If the recording shows no vibration, or no two-mass model fits it.
    """
    from phantom_dyn.haptics.experiments.frequency_identification import fit_two_mass_of_instants

    return fit_two_mass_of_instants(joint_response(log, joint, segment=segment))


def _longest_valid(log: Log) -> slice:
    """The longest run of samples that may be used."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], log.valid, [False]]).astype(int)))
    if len(edges) == 0:
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return slice(int(starts[longest]), int(stops[longest]))
