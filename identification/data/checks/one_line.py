"""Checks whether joints move in proportion, and how many inertial parameters the motion can then identify.

If several joints follow one profile, their torques are functions of one variable. Friction can be identified, but only
a few combinations of inertias, because many different inertias cause the same torque.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from identification.data.checks.smoothed_copy import SmoothedRecording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Two joints move along one line if the absolute correlation of their velocities is above this number. Joints that a
# planner starts and stops together have 0.6 to 0.9; joints that follow one profile, some milliseconds apart, have 0.99
# or more.
_CORRELATION = 0.97
# A motion is one sine if more than this share of the power is in the strongest peak of its spectrum. The peak includes
# this number of frequency bins on either side.
_SINE_SHARE, _PEAK_BINS = 0.98, 3
# A joint moves if its speed is above this share of the fastest joint's speed, both root mean squares.
_STILL = 1e-3
# Number of samples of the regressor.
_ROWS = 400
# A combination of parameters is identifiable if it changes the torque by more than this share when it is as large as
# the links' own parameters. Modelled links have errors of about this size.
_SHOWN = 0.05
# A combination causes no torque in any motion if its singular value is below this share of the largest one.
_STRUCTURAL = 1e-6


class Separated(NamedTuple):
    """Numbers of combinations of inertial parameters that can be identified from a motion.

    Attributes:
        shown: Number of combinations that change the torque by more than a twentieth when they are as large as the
            links' own parameters.
        all: Number of combinations that cause a torque in some motion (base parameters).
        condition: Condition number of the base parameters' columns, each divided by its norm.
    """

    shown: int
    all: int
    condition: float


def lines_of(v: Float[Array, "N nv"]) -> tuple[tuple[int, ...], ...]:
    """Indices of joints in groups of two or more whose velocities are proportional.

    Args:
        v: Velocities [rad/s or m/s].
    """
    size = np.sqrt(np.mean(v**2, axis=0))
    moving = np.flatnonzero(size > _STILL * max(float(size.max(initial=0.0)), 1e-300))
    unit = v[:, moving] / size[moving] if len(moving) else v[:, :0]
    along = np.abs(unit.T @ unit / max(len(v), 1)) > _CORRELATION
    _, labels = connected_components(along, directed=False)
    groups = [moving[labels == label] for label in dict.fromkeys(labels.tolist())]
    return tuple(tuple(group.tolist()) for group in groups if len(group) > 1)


def is_one_sine(x: Float[Array, " N"]) -> bool:
    """True for a position ``x`` of one frequency.

    The torque of such a motion has only two amplitudes, one in phase with the velocity and one with the position.
    """
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
    peak = int(np.argmax(power[1:])) + 1 if len(power) > 1 else 0
    around = power[max(peak - _PEAK_BINS, 0) : peak + _PEAK_BINS + 1]
    # With fewer periods than the width of the peak, the signal may be any slow motion.
    return bool(peak > _PEAK_BINS and around.sum() > _SINE_SHARE * power[1:].sum())


def separated(robot: Robot, motion: Motion) -> Separated:
    """Numbers of combinations of inertial parameters that a motion shows, and their condition number.

    The number of base parameters is found from a copy of the motion, in which each joint is shifted in time by a
    different amount, so that the joints move independently.

    Args:
        robot: The given model.
        motion: Samples of a recording.
    """
    count = len(motion.t)
    rows = np.linspace(0, count - 1, min(count, _ROWS)).astype(int)
    # Multiples of the golden ratio, modulo 1, differ as much as possible between the joints.
    shifts = [int(count * (joint * 0.381966 % 1.0)) for joint in range(robot.nv)]
    shifted = Motion(motion.t[rows], *(_shifted(x, shifts)[rows] for x in (motion.q, motion.v, motion.a)))
    w, w_shifted = rigid_body_regressor(robot, motion.at(rows)), rigid_body_regressor(robot, shifted)
    # The rows of each joint are divided by its modelled torque, so that all joints count alike.
    torque_rms = np.sqrt(np.mean((w @ standard_parameters(robot)) ** 2, axis=0))
    torque_rms = np.where(torque_rms > 0.0, torque_rms, max(float(torque_rms.max()), 1e-300))[None, :, None]
    w, w_shifted = ((part / torque_rms).reshape(-1, part.shape[2]) for part in (w, w_shifted))
    values = _singular_values(w_shifted / np.maximum(np.linalg.norm(w_shifted, axis=0), 1e-300))
    rank = int(np.sum(values > _STRUCTURAL * values[0]))
    values_of_motion = _singular_values(w / np.maximum(np.linalg.norm(w, axis=0), 1e-300))[:rank]
    shown = _singular_values(w * _parameter_scales(robot)) / np.sqrt(len(rows))
    condition = float(values_of_motion[0] / max(float(values_of_motion[-1]), 1e-12 * float(values_of_motion[0])))
    return Separated(min(int(np.sum(shown > _SHOWN)), rank), rank, condition)


def _parameter_scales(robot: Robot) -> Float[Array, " p"]:
    """Scale of each inertial parameter: the link's mass times a power (0, 1 or 2) of its radius of gyration.

    Links without mass or size get a thousandth of the largest mass or radius.
    """
    bodies = standard_parameters(robot).reshape(-1, 10)
    mass = np.maximum(bodies[:, 0], 1e-3 * max(float(bodies[:, 0].max()), 1e-300))
    radius = np.sqrt(np.maximum(0.5 * (bodies[:, 4] + bodies[:, 6] + bodies[:, 9]), 0.0) / mass)
    radius = np.maximum(radius, 1e-3 * max(float(radius.max()), 1e-300))[:, None]
    return (mass[:, None] * np.hstack([radius**0, *[radius] * 3, *[radius**2] * 6])).ravel()


def _singular_values(w: Float[Array, "m p"]) -> Float[Array, " p"]:
    """Singular values of a matrix, largest first."""
    return np.linalg.svd(w, compute_uv=False)


def _shifted(x: Float[Array, "N nv"], shifts: list[int]) -> Float[Array, "N nv"]:
    """The samples with each joint's column rotated by its number of rows."""
    return np.column_stack([np.roll(column, shift) for column, shift in zip(x.T, shifts, strict=True)])


def check_one_line(robot: Robot, smooth: SmoothedRecording) -> tuple[str, ...]:
    """A warning for each group of joints that move along one line.

    Empty if the robot has closed chains, or joints whose position is a quaternion or an angle as two numbers.
    """
    if robot.chain is not None or robot.model.nq != robot.nv:
        return ()
    inside = smooth.inside
    lines = lines_of(smooth.v[inside])
    if not lines:
        return ()
    found = separated(robot, smooth.motion(inside))
    return tuple(one_line_words([robot.joint_names[row] for row in line], found) for line in lines)


def one_line_words(names: list[str], found: Separated) -> str:
    """The warning on a group of joints that move along one line."""
    joints = ", ".join(names[:-1]) + f" and {names[-1]}"
    condition = f"(condition {found.condition:.0f})"
    # Even if all base parameters can be identified, the torques of other causes may add up to the torque of a link.
    reason = (
        f": of the {found.all} base parameters of the links {found.shown} show {condition}"
        if found.shown < found.all
        else f". All {found.all} base parameters of the links show {condition}, but several other causes together may "
        "look like one of them"
    )
    return (
        f"{joints} move along one line (their velocities are proportional){reason}. Friction can be found there, but "
        "no payload, no single link and no torque scale with certainty: record joints that move independently of "
        "each other."
    )
