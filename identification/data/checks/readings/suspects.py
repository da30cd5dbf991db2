"""Lists suspected mistakes in a recording: wrong units, signs and orders of columns, with entries that correct them.

Each suspect can make a reading: the data with its mistake corrected. `identification.data.checks.better_readings`
decides which suspect is right, from how well the readings fit the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from identification.data.checks.readings.reading import (
    Reading,
    with_order,
    with_positions_plus,
    with_positions_times,
    with_time_times,
    with_torques_times,
)
from identification.data.readers.map_entries import entries, entries_words, joint_entries
from identification.data.recording import Fault, Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

_DEGREE = np.pi / 180  # [rad]
_MILLIMETRE = 1e-3  # [m]
# Smallest and largest sampling time of robots' recorders [s].
_FASTEST, _SLOWEST = 2e-5, 0.2
# Largest travel [m] and speed [m/s] of any linear axis. A recording in mm exceeds them beyond 20 mm and 50 mm/s.
_FARTHEST, _FASTEST_AXIS = 20.0, 50.0
# Sampling time [s] from which on another unit of time is expected: with such slow samples, a motion shows no inertia.
_SLOW_SAMPLING = 1.0
# Sampling time [s] that no recording of a motion has.
_IMPOSSIBLE_SAMPLING = 100.0
# A unit is suspected if measured and modelled torque agree in this unit within a factor of 2.5, of which this is the
# logarithm. Units differ by a factor of ten or more.
_NEAR_UNIT = float(np.log(2.5))
# Logarithm of the smallest gear ratio with which the two sides of a gear can be distinguished.
_GEARED = float(np.log(2.0))
# Offsets [rad] between the zeros that different conventions give a joint.
_QUARTERS = (np.pi / 2, np.pi, -np.pi / 2)
_TIMES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_OR_GRAMS = ", or the masses of the model in g and not in kg"
TORQUE_UNITS = {"Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}

Kind = Literal[
    "time", "degrees", "length", "sign", "order", "torque", "factors", "gears", "voltage", "gravity", "attitude", "pair"
]


@dataclass(frozen=True)
class Suspect:
    """A suspected mistake in a recording.

    Attributes:
        kind: The kind of mistake.
        joints: Joints whose fit improves directly if the mistake is corrected.
        what: The mistake in words, such as ``the time is in ms``.
        entries: Entries of a column map that correct the mistake, by their keys.
        read: Function that corrects the mistake in a reading.
        expected: True if the correction is very likely before any fit. Then the corrected data need not fit far better
            than the data as recorded.
        moves: True if the correction changes positions, and so the modelled torque of every joint.
        turned: True if the correction changes only positions of joints that turn more than once as recorded.
        outcome: What to report if this suspect fits best. ``wrong``: the recording has a certain fault. ``offer``: the
            mistake is possible, and a sentence says how to correct it. ``rival``: a certain fault, too,
            but another mistake that fits equally well is reported in its place.
        price: 0 for a usual mistake; 1 if it has fitted numbers, such as gear ratios; 2 if it also needs a load that
            the model lacks. A suspect with a higher price has to fit far better than one with a lower price.
        advice: Advice for the user in addition to the entries, or in place of entries that do not exist.
        parts: The two mistakes of a pair.
        model: The corrected model, if the mistake is in the model and not in the data.
    """

    kind: Kind
    joints: tuple[int, ...]
    what: str
    entries: dict[str, str]
    read: Callable[[Reading], Reading]
    outcome: Literal["wrong", "offer", "rival"] = "wrong"
    expected: bool = False
    moves: bool = False
    turned: bool = False
    price: int = 0
    advice: str = ""
    parts: tuple[Suspect, ...] = ()
    model: Robot | None = None

    def after(self, first: Suspect) -> Suspect:
        """Both mistakes as one suspect, with the joints of both; ``first`` is corrected first."""
        joints = tuple(sorted({*self.joints, *first.joints}))
        return replace(
            self,
            kind="pair",
            joints=joints,
            read=lambda reading: self.read(first.read(reading)),
            outcome="wrong",
            expected=False,
            moves=self.moves or first.moves,
            parts=(first, self),
        )


def time_suspects(robot: Robot, step: float) -> list[Suspect]:
    """The suspected mistakes that the time is in ms, us or ns; only units with which the sampling time is usual.

    Args:
        robot: Gives the joints.
        step: Median time between two samples, in the unit of the data.
    """
    return [
        Suspect(
            "time",
            tuple(range(robot.nv)),
            f"the time is in {unit} and not in s",
            {"t": f"{{from: t, unit: {unit}}}"},
            lambda reading, factor=factor: with_time_times(reading, factor),
            expected=step >= _SLOW_SAMPLING,
        )
        for unit, factor in _TIMES.items()
        if _FASTEST <= step * factor <= _SLOWEST
    ]


def usual_clock(recording: Recording) -> float:
    """Factor from recorded times to seconds, for the largest of ms, us and ns with a usual sampling time; else 1."""
    step = float(np.median(np.diff(recording.t)))
    return next((factor for factor in _TIMES.values() if _FASTEST <= step * factor <= _SLOWEST), 1.0)


def slow_clock(recording: Recording) -> Fault | None:
    """The fault of a recording whose samples are minutes apart, if another unit of time gives a usual sampling time."""
    step = float(np.median(np.diff(recording.t)))
    units = [unit for unit, factor in _TIMES.items() if _FASTEST <= step * factor <= _SLOWEST]
    if step < _IMPOSSIBLE_SAMPLING or not units:
        return None
    return Fault(
        f"the time is in {' or '.join(units)} and not in s",
        f"as recorded a sample comes every {step:.3g} s",
        entries_words(recording, {"t": f"{{from: t, unit: {units[0]}}}"}),
    )


def degree_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistakes that positions are in degrees: of all revolute joints, of those that move far, or of one.

    Args:
        robot: Gives the joints.
        reading: The data as recorded; positions in degrees mostly exceed half a turn of radians.
    """
    turning = ~robot.prismatic
    most = np.abs(reading.motion.q).max(axis=0)
    far = np.flatnonzero(turning & (most > np.pi)).tolist()
    if not far:
        return []
    beyond = np.flatnonzero(turning & (most > 2 * np.pi)).tolist()
    sets = [tuple(np.flatnonzero(turning).tolist()), tuple(far), tuple(beyond), *((j,) for j in far)]
    out = []
    for joints in dict.fromkeys(sets):
        if not joints:
            continue
        subject = "positions of {} are" if len(joints) > 1 else "position of {} is"
        factor = _times(robot, joints, _DEGREE)
        out.append(
            Suspect(
                "degrees",
                joints,
                f"the {subject.format(names(robot, joints))} in degrees and not in rad",
                entries(robot, "q", joints, "unit: deg"),
                lambda reading, factor=factor: with_positions_times(reading, factor),
                moves=True,
                turned=set(joints) <= set(beyond),
            )
        )
    return out


def _times(robot: Robot, joints: Sequence[int], factor: float) -> Float[Array, " nv"]:
    """Factors of all joints: ``factor`` for some joints, 1 for the others."""
    out = np.ones(robot.nv)
    out[list(joints)] = factor
    return out


def highest_speed(robot: Robot, reading: Reading) -> float:
    """Highest speed of a linear joint [m/s]; 0 without linear joints."""
    return float(np.abs(reading.motion.v[:, robot.prismatic]).max(initial=0.0))


def length_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistake that positions of all linear joints are in mm, if they travel farther than any axis."""
    joints = tuple(np.flatnonzero(robot.prismatic).tolist())
    if not joints or np.ptp(reading.motion.q[:, joints], axis=0).max() < _FARTHEST:
        return []
    factor = np.where(robot.prismatic, _MILLIMETRE, 1.0)
    # The suspect concerns all joints: a body that slides far out changes the torques of the joints before it, too.
    return [
        Suspect(
            "length",
            tuple(range(robot.nv)),
            f"the positions of {names(robot, joints)} are in mm and not in m",
            entries(robot, "q", joints, "unit: mm"),
            lambda reading: with_positions_times(reading, factor),
            expected=highest_speed(robot, reading) > _FASTEST_AXIS,
        )
    ]


def sign_suspects(robot: Robot, poor: Sequence[int]) -> list[Suspect]:
    """The suspected mistakes that torque, position or both of a joint have the wrong sign, and rivals of these.

    A rival says that no sign is wrong, and that the joint is counted from another zero.

    Args:
        robot: Gives the joints.
        poor: Joints that fit poorly as recorded.
    """
    out = []
    for j in poor:
        factor = np.ones(robot.nv)
        factor[j] = -1.0
        joint = robot.joint_names[j]
        out += [
            Suspect(
                "sign",
                (j,),
                f"the torque of {joint} has the wrong sign",
                entries(robot, "tau", (j,), "sign: -1"),
                lambda reading, factor=factor: with_torques_times(reading, factor),
            ),
            Suspect(
                "sign",
                (j,),
                f"the position of {joint} is counted the other way round",
                entries(robot, "q", (j,), "sign: -1"),
                lambda reading, factor=factor: with_positions_times(reading, factor),
                moves=True,
            ),
            Suspect(
                "sign",
                (j,),
                f"position and torque of {joint} are counted the other way round",
                entries(robot, "q", (j,), "sign: -1") | entries(robot, "tau", (j,), "sign: -1"),
                lambda reading, factor=factor: with_torques_times(with_positions_times(reading, factor), factor),
                moves=True,
            ),
            *(_other_zero(robot, j, turn) for turn in (_QUARTERS if not robot.prismatic[j] else ())),
        ]
    return out


def _other_zero(robot: Robot, j: int, turn: float) -> Suspect:
    """The suspect that the zero of joint ``j`` in the model is ``turn`` [rad] from that in the recording.

    It is a rival of a wrong sign, and of another attitude of the base.
    """
    shift = np.zeros(robot.nv)
    shift[j] = turn
    return Suspect(
        "sign",
        (j,),
        f"the zero of {robot.joint_names[j]} is {abs(turn):.3g} rad from that of the model",
        entries(robot, "q", (j,), f"offset: {turn:.6g}"),
        lambda reading: with_positions_plus(reading, shift),
        outcome="rival",
        moves=True,
    )


def order_suspects(robot: Robot, poor: Sequence[int]) -> list[Suspect]:
    """The suspected exchanges of torques, positions or both between two joints, of which at least one fits poorly.

    Args:
        robot: Gives the joints.
        poor: Joints that fit poorly as recorded.
    """
    out = []
    for i, j in combinations(range(robot.nv), 2):
        if i not in poor and j not in poor:
            continue
        order = np.arange(robot.nv)
        order[[i, j]] = j, i
        a, b = robot.joint_names[i], robot.joint_names[j]
        for quantities, what in ((("tau",), "torques"), (("q",), "positions"), (("q", "tau"), "columns")):
            positions, torques = "q" in quantities, "tau" in quantities
            swapped: dict[str, str] = {}
            for x in quantities:
                swapped |= {f"{x}.{a}": f"{x}.{b}", f"{x}.{b}": f"{x}.{a}"}
            out.append(
                Suspect(
                    "order",
                    (i, j),
                    f"the {what} of {a} and {b} are swapped",
                    swapped,
                    lambda reading, order=order, positions=positions, torques=torques: with_order(
                        reading, order.tolist(), positions=positions, torques=torques
                    ),
                )
            )
    return out


def all_signs(robot: Robot) -> list[Suspect]:
    """The suspected mistake that the torques of all joints have the wrong sign; empty for a single joint."""
    every = tuple(range(robot.nv))
    if robot.nv == 1:
        return []
    return [
        Suspect(
            "torque",
            every,
            "the torques of all joints have the wrong sign",
            entries(robot, "tau", every, "sign: -1"),
            lambda reading: with_torques_times(reading, -np.ones(robot.nv)),
        )
    ]


def torque_suspects(robot: Robot, ratio: float | None) -> list[Suspect]:
    """The suspected mistakes that the torques of all joints are in another unit, or on the motor's side of the gears.

    Args:
        robot: Gives the joints and their gears.
        ratio: Measured over modelled torque, if it is about the same for all joints; else None.
    """
    every = tuple(range(robot.nv))
    factors: list[tuple[str, dict[str, str], Float[Array, " nv"]]] = []
    for unit, factor in TORQUE_UNITS.items():
        # If all joints have the same ratio, only the nearest unit is tried: a fitted payload could make others fit.
        if ratio is not None and unit != _nearest_unit(ratio):
            continue
        factors.append(
            (
                f"the torques are in {unit} and not in N m{_OR_GRAMS if unit == 'kNm' else ''}",
                entries(robot, "tau", every, f"unit: {unit}"),
                np.full(robot.nv, factor),
            )
        )
    gears = np.array([abs(actuator.gear_ratio) for actuator in robot.actuators])
    if np.any(np.abs(np.log(gears)) > _GEARED):
        stated = {j: f"gear: {gears[j]:.6g}" for j in every}
        inverse = {j: f"gear: {1 / gears[j]:.6g}" for j in every}
        factors.append(("the torques are on the motor's side of the gears", joint_entries(robot, "tau", stated), gears))
        factors.append(
            ("the torques were taken through the gears twice", joint_entries(robot, "tau", inverse), 1 / gears)
        )
    return [
        Suspect("torque", every, what, mended, lambda reading, factor=factor: with_torques_times(reading, factor))
        for what, mended, factor in factors
    ]


def _nearest_unit(ratio: float) -> str | None:
    """The unit that explains a ratio of measured to modelled torque best; None if it is far from that of every unit."""
    distance = {unit: abs(np.log(ratio * factor)) for unit, factor in TORQUE_UNITS.items()}
    unit = min(distance, key=lambda name: distance[name])
    return unit if distance[unit] <= _NEAR_UNIT else None


def names(robot: Robot, joints: Sequence[int]) -> str:
    """Names of joints as a list in a sentence."""
    return listed([robot.joint_names[j] for j in joints])
