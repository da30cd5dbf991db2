"""Finds references of position controllers that the positions cannot follow: wrong units, signs, orders and zeros.

A drive may follow its reference with any delay up to half a second, with rotor inertia and friction, and with an error
that grows with the weight and inertia of the links that it moves. A mistake is certain if such a drive explains the
motion far better after the correction than as recorded, and then explains nearly all of the motion, in both halves of
the recording, as in `identification.data.checks.better_readings`. Soft, late or saturated drives follow badly, too, but
no correction makes them follow far better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from identification.data.checks.readings.plausible_fit import ENOUGH, PLAUSIBLE, bounded_fit, mean_inertia
from identification.data.checks.readings.reading import Reading, reading_of, with_order, with_torques_times
from identification.data.checks.readings.reading_fits import FAR_BETTER, RIGHT, ReadingFit, is_certain
from identification.data.checks.readings.suspects import Kind, Suspect, names
from identification.data.checks.smoothed_copy import smoothed
from identification.data.readers.map_entries import entries, entries_after, entries_words, joint_entries
from identification.data.recording import Fault, Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Delays of the reference that are tried [s]. The columns of speed and acceleration explain delays between these.
_DELAYS = np.arange(0.0, 0.55, 0.1)
# Largest factor between the gain of a drive and the stated one.
_GAIN = 2.0
# Cost of giving a joint the reference of another joint. An exchange of two references costs twice as much: it has to
# fit far better.
_MOVED = FAR_BETTER / 2
# Number of mistakes that are found one after the other, and largest number of joints whose references are reordered.
_MOST_FAULTS, _MOST_JOINTS = 3, 12
# Positions and references have different zeros if their median difference is a multiple of a quarter turn to within the
# second number [rad], and if the standard deviation of the difference is below the third number times this multiple.
_QUARTER, _NEAR, _STEADY = np.pi / 2, 0.05, 0.1
_CONSTANT = 3  # index of the constant among the columns of `_Following`


@dataclass(frozen=True)
class _Following:
    """Samples of a motion and its references.

    Attributes:
        q: Positions [rad or m], ``(N, nv)``.
        columns: Causes of a following error, which is reference minus position, ``(N, nv, 6)``: velocity, acceleration,
            sign of velocity, a constant, weight, and inertial torque of the links.
        largest: Largest coefficients of the columns, ``(nv, 6)``. The smallest is 0, except for the constant.
        delayed: The data as recorded, one reading for each delay. In place of the torque, a reading has the reference.
    """

    q: Float[Array, "N nv"]
    columns: Float[Array, "N nv 6"]
    largest: Float[Array, "nv 6"]
    delayed: tuple[Reading, ...]


def reference_faults(recording: Recording, robot: Robot) -> tuple[Fault, ...]:
    """Certain mistakes in the references of a recording without torque.

    Args:
        recording: Raw samples.
        robot: The given model.
    """
    data = _following(recording, robot)
    if data is None:
        return ()
    found = _mistakes(robot, data)
    if not found:
        return _other_zeros(recording, robot, data)
    out, earlier = [], {}
    for one in found:
        corrections = entries_after(earlier, one.suspect.entries)
        earlier |= corrections
        j = int(np.nanargmax(one.joint_gains))
        percent = max(100 * float(np.nanmax(one.unexplained[:, j])), 0.1)
        joint = robot.joint_names[j]
        why = (
            f"as recorded {joint} does not follow its reference, whatever delay, inertia, friction and gain its drive "
            f"has; read so, all but {percent:.2g} % of its motion does"
        )
        out.append(Fault(one.suspect.what, why, f"{entries_words(recording, corrections)}{one.suspect.advice}"))
    return tuple(out)


def _following(recording: Recording, robot: Robot) -> _Following | None:
    """The samples of a recording; None without references, or with too few samples."""
    if recording.q_ref is None or not np.isfinite(recording.q_ref).all():
        return None
    t = recording.t
    delayed = [np.column_stack([np.interp(t - delay, t, column) for column in recording.q_ref.T]) for delay in _DELAYS]
    smooth = smoothed(replace(recording, tau=np.hstack(delayed)))
    # In the first half second, references with long delays are not known.
    known = None if smooth is None else replace(smooth, inside=smooth.inside & (smooth.t > t[0] + _DELAYS[-1]))
    reading = None if known is None else reading_of(known)
    if reading is None:
        return None
    weight = gravity_torque(robot, reading.motion.q)
    inertia = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion) - weight
    columns = [reading.motion.v, reading.motion.a, reading.sign, np.ones_like(weight), weight, inertia]
    controllers = [actuator.controller for actuator in robot.actuators]
    gains = np.array([0.0 if controller is None else controller.kp for controller in controllers])
    # A torque makes a following error of torque / gain. Without a stated gain, the error has no limit.
    per_torque = np.where(gains > 0, _GAIN / np.maximum(gains, 1e-300), np.inf)
    largest = np.full((robot.nv, len(columns)), np.inf)
    largest[:, 1] = per_torque * PLAUSIBLE.rotor * mean_inertia(robot, reading.motion.q)
    largest[:, 4:] = per_torque[:, None]
    parts = np.split(reading.tau, len(_DELAYS), axis=1)
    readings = tuple(replace(reading, tau=part) for part in parts)
    return _Following(reading.motion.q, np.stack(columns, axis=2), largest, readings)


def _share(data: _Following, half: slice, j: int, references: Sequence[Float[Array, " N"]]) -> float:
    """Share of the motion of joint ``j`` that does not follow its reference, with the best of the delays.

    It is the squared following error that no drive explains, divided by the same for a constant reference: a joint may
    also swing by itself.

    Args:
        data: Samples of the recording.
        half: The half of the recording that is used.
        j: Index of the joint.
        references: The reference with each delay.

    Returns:
        The share; NaN if the joint does not move, or if a constant reference explains all of its motion.
    """
    q, columns = data.q[half, j], data.columns[half, j]
    if not np.ptp(q) > 0:
        return np.nan
    low = np.where(np.arange(columns.shape[1]) == _CONSTANT, -np.inf, 0.0)
    errors = [reference[half] - q for reference in (*references, np.zeros_like(data.q[:, j]))]
    residuals = [error - columns @ bounded_fit(columns, error, low, data.largest[j]) for error in errors]
    *squares, by_itself = (float(residual @ residual) for residual in residuals)
    return min(squares) / by_itself if by_itself > 0 else np.nan


def _halves(data: _Following) -> tuple[slice, slice]:
    """The rows of each half of the recording."""
    middle = len(data.q) // 2
    return slice(None, middle), slice(middle, None)


def _shares(data: _Following, readings: Sequence[Reading]) -> Float[Array, "2 nv"]:
    """Share of each joint's motion that does not follow its reference, in each half of the recording, by `_share`.

    Args:
        data: Samples of the recording.
        readings: The references with each delay, as the torques of readings.
    """
    joints = range(data.q.shape[1])
    references = [[reading.tau[:, j] for reading in readings] for j in joints]
    return np.array([[_share(data, half, j, references[j]) for j in joints] for half in _halves(data)])


def _mistakes(robot: Robot, data: _Following) -> list[ReadingFit]:
    """Mistakes that are certain, one after the other: each is found after those before it were corrected."""
    out: list[ReadingFit] = []
    for _ in range(_MOST_FAULTS):
        before = _shares(data, data.delayed)
        poor = np.flatnonzero(np.nan_to_num(before).max(axis=0) > RIGHT).tolist()
        if not poor:
            return out
        units = _units(robot, poor)
        suspects = [*units, *_signs(robot, poor), *_orders(robot, data)]
        fits = [_fit(data, before, suspect) for suspect in suspects]
        certain = [one for one in fits if is_certain(one)]
        if not certain:
            return out
        best = max(certain, key=lambda one: one.score)
        out.append(best)
        data = replace(data, delayed=tuple(best.suspect.read(reading) for reading in data.delayed))
    return out


def _fit(data: _Following, before: Float[Array, "2 nv"], suspect: Suspect) -> ReadingFit:
    """Fit of positions to references with a suspected mistake corrected, compared with the data as recorded."""
    shares = _shares(data, [suspect.read(reading) for reading in data.delayed])
    return ReadingFit(suspect, np.log((before + ENOUGH) / (shares + ENOUGH)), shares)


def _units(robot: Robot, poor: Sequence[int]) -> list[Suspect]:
    """The suspected mistakes that references or positions are in degrees or mm: of all joints, or of one."""
    out = []
    for linear, unit, si_unit, factor in ((False, "degrees", "rad", np.pi / 180), (True, "mm", "m", 1e-3)):
        every = tuple(np.flatnonzero(robot.prismatic == linear).tolist())
        sets = dict.fromkeys([every, *((j,) for j in poor if j in every)]) if every else {}
        kind: Kind = "length" if linear else "degrees"
        for joints in sets:
            option = f"unit: {'mm' if linear else 'deg'}"
            for quantity, word, times in (("q_ref", "reference", factor), ("q", "position", 1 / factor)):
                scale = np.where(np.isin(range(robot.nv), joints), times, 1.0)
                what = f"{_sentence_start(word, robot, joints)} in {unit} and not in {si_unit}"
                out.append(
                    Suspect(
                        kind,
                        joints,
                        what,
                        entries(robot, quantity, joints, option),
                        lambda reading, scale=scale: with_torques_times(reading, scale),
                    )
                )
    return out


def _sentence_start(word: str, robot: Robot, joints: Sequence[int]) -> str:
    """Start of a sentence, such as ``the references of j1 and j2 are``."""
    several = len(joints) > 1
    return f"the {word}{'s' * several} of {names(robot, joints)} {'are' if several else 'is'}"


def _signs(robot: Robot, poor: Sequence[int]) -> list[Suspect]:
    """The suspected mistakes that a reference is counted the other way round: of all poor joints, or of one."""
    return [
        Suspect(
            "sign",
            joints,
            f"{_sentence_start('reference', robot, joints)} counted the other way round",
            entries(robot, "q_ref", joints, "sign: -1"),
            lambda reading, joints=joints: with_torques_times(
                reading, np.where(np.isin(range(reading.tau.shape[1]), joints), -1.0, 1.0)
            ),
            advice=_or_positions(robot, joints),
        )
        for joints in dict.fromkeys([tuple(poor), *((j,) for j in poor)])
    ]


def _or_positions(robot: Robot, joints: Sequence[int]) -> str:
    """Advice to correct the positions in place of the references, where the data do not show which are wrong."""
    columns = listed([f"q.{robot.joint_names[j]}" for j in joints])
    return f"; or mend {columns} in the same way, if the model says so of the positions"


def _orders(robot: Robot, data: _Following) -> list[Suspect]:
    """The suspected mistake that references are in the columns of other joints, in the order that fits best."""
    if not 1 < robot.nv <= _MOST_JOINTS:
        return []
    joints = range(robot.nv)
    costs = np.zeros((robot.nv, robot.nv))  # of joint i with the reference in the column of joint j
    for i in joints:
        for j in joints:
            references = [reading.tau[:, j] for reading in data.delayed]
            shares = [_share(data, half, i, references) for half in _halves(data)]
            costs[i, j] = np.nanmean(np.log(np.array(shares) + ENOUGH)) if np.isfinite(shares).any() else 0.0
    order = linear_sum_assignment(costs + _MOVED * (1 - np.eye(robot.nv)))[1].tolist()
    moved = tuple(j for j in joints if order[j] != j)
    if not moved:
        return []
    swapped = len(moved) == 2
    return [
        Suspect(
            "order",
            moved,
            f"{_sentence_start('reference', robot, moved)} {'swapped' if swapped else 'in the columns of each other'}",
            {f"q_ref.{robot.joint_names[j]}": f"q_ref.{robot.joint_names[order[j]]}" for j in moved},
            lambda reading: with_order(reading, order, positions=False, torques=True),
            advice=_or_positions(robot, moved) if swapped else "",
        )
    ]


def _other_zeros(recording: Recording, robot: Robot, data: _Following) -> tuple[Fault, ...]:
    """The fault of references that are quarter turns from the positions that follow them."""
    error = data.delayed[0].tau - data.q
    difference = np.median(error, axis=0)
    zero = _QUARTER * np.round(difference / _QUARTER)
    follows = np.nan_to_num(_shares(data, data.delayed), nan=np.inf).max(axis=0) <= RIGHT
    steady = (np.abs(difference - zero) < _NEAR) & (error.std(axis=0) < _STEADY * np.abs(zero))
    joints = np.flatnonzero(~robot.prismatic & follows & steady).tolist()
    if not joints:
        return ()
    corrections = joint_entries(robot, "q_ref", {j: f"offset: {-zero[j]:.6g}" for j in joints})
    j = joints[0]
    joint = robot.joint_names[j]
    return (
        Fault(
            f"the zero of {listed([f'q_ref.{robot.joint_names[k]}' for k in joints])} is not that of the positions",
            f"{joint} follows its reference, but {difference[j]:.4g} rad from it, give or take {error[:, j].std():.2g}",
            f"{entries_words(recording, corrections)}; or give q.{joint} that offset with the other sign, if the model "
            "has its zero where the references have it",
        ),
    )
