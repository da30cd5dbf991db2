# pyright: reportAttributeAccessIssue=false
"""Certain faults of a recording or of the model, with which a diagnosis would be meaningless.

A fault is certain if no plausible robot explains the data as recorded, but one explains the data in another unit, with
another sign or in another order (`identification.data.checks.better_readings`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from identification.data.checks.better_readings import Compared, better_readings, leaves_little
from identification.data.checks.exchanged_columns import exchanged_columns
from identification.data.checks.model_units import wrong_units
from identification.data.checks.readings.plausible_fit import ENOUGH
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.suspects import Suspect, highest_speed
from identification.data.checks.torques.missing_torques import missing_torque
from identification.data.checks.torques.torque_factors import factor_suspects
from identification.data.checks.torques.torque_scales import load_or_current, torque_scales
from identification.data.checks.torques.unsigned_torques import unsigned_fault
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction, standard_parameters
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Largest number of joints: with more, fits of all other units, signs and orders would take longer than a diagnosis.
_MOST_JOINTS = 12


def massless_model(robot: Robot) -> tuple[Fault, ...]:
    """The fault of a model without mass or inertia in any link; a single joint may be a motor with a rotor only."""
    if np.any(standard_parameters(robot)) or (robot.nv == 1 and np.any(robot.model.armature)):
        return ()
    name = Path(robot.source).name if robot.source else robot.name
    return (
        Fault(
            f"no moving link of {name} has mass",
            "its links need no torque for any motion",
            f"give every link of {name} its mass and inertia (<inertial> in a URDF), or take a file that has them",
        ),
    )


def certain_faults(
    recording: Recording, robot: Robot, reading: Reading | None
) -> tuple[tuple[Fault, ...], tuple[str, ...]]:
    """Certain faults of a recording or of the model, and sentences on statements that the user may have to add.

    Args:
        recording: Raw samples.
        robot: The given model.
        reading: Some of its samples, smoothed; None where there is no torque to compare with the model.
    """
    model_faults = massless_model(robot) or wrong_units(robot)
    if model_faults or reading is None:
        return model_faults, ()
    needed = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    missing = missing_torque(recording, robot, reading, needed)
    if missing is not None:
        return (missing,), ()
    if robot.nv > _MOST_JOINTS:
        return (), ()
    exchanged = exchanged_columns(recording, robot, reading)
    if exchanged is not None:
        return (exchanged,), ()
    unsigned = unsigned_fault(recording, reading, needed)
    if unsigned is not None:
        return (unsigned,), ()
    step = float(np.median(np.diff(recording.t)))
    found = better_readings(robot, reading, step)
    wrong = [one for one in found if one.suspect.says == "wrong"]
    faults = tuple(_fault(recording, robot, reading, one) for one in wrong)
    offers = tuple(_offer(recording, one) for one in found if one.suspect.says == "offer")
    if wrong and not (any(one.suspect.expected for one in wrong) or leaves_little(wrong[-1])):
        rest = wrong[-1].left
        j = int(np.nanargmax(np.nanmax(rest, axis=0)))
        more = f"{100 * float(np.nanmax(rest[:, j])):.2g} % of the torque of {robot.joint_names[j]} are left then"
        offers += tuple(
            f"{recording.file}: it may be that {fault.what} ({fault.why}): {fault.mend}; but {more}, so that there is "
            "another mistake, or this is none."
            for fault in faults
        )
        faults = ()
    return faults, offers


def _offer(recording: Recording, found: Compared) -> str:
    """The sentence on a torque without gravity."""
    return (
        f"{recording.file}: {found.suspect.what} that the model has: if a controller had taken gravity out, "
        f"{_advice(recording, found.suspect)}; if the robot stands or hangs otherwise, state gravity in robot.yaml."
    )


def load_or_current_words(recording: Recording, robot: Robot, reading: Reading | None) -> tuple[str, ...]:
    """Sentence on torques that all exceed the modelled ones by the same factor: a load, or a motor current.

    Args:
        recording: The recording; torques that were computed from another quantity are left out.
        robot: The given model.
        reading: Some of its samples, smoothed.
    """
    if reading is None or set(recording.torque_from.values()) - {"tau"} or robot.nv > _MOST_JOINTS:
        return ()
    found = load_or_current(robot, torque_scales(robot, reading))
    if found is None:
        return ()
    for suspect in factor_suspects(robot, reading):
        if suspect.kind == "voltage":
            return (f"{recording.file}: {suspect.what}: {suspect.advice}.",)
    words, entries = found
    return (
        f"{recording.file}: {words}, {entries_words(recording, entries)}, or state torque_constant and gear_ratio in "
        "robot.yaml and name the columns i.<joint>.",
    )


def _fault(recording: Recording, robot: Robot, reading: Reading, found: Compared) -> Fault:
    """The fault that a better reading of the data shows."""
    what = " or ".join([found.suspect.what, *(one.what for one in found.twins)])
    mend = "; or, as that fits equally well, ".join(_advice(recording, one) for one in (found.suspect, *found.twins))
    if found.suspect.expected:
        step, speed = float(np.median(np.diff(recording.t))), highest_speed(robot, reading)
        why = (
            f"as recorded a joint moves at up to {speed:.3g} m/s"
            if found.suspect.kind == "length"
            else f"as recorded a sample comes every {step:.3g} s, and so slow a motion would show no inertia"
        )
        return Fault(what, why, mend)
    j = int(np.nanargmax(found.of_joints))
    after, gain = np.nanmax(found.left[:, j]), found.of_joints[j]
    before = min(1.0, (after + ENOUGH) * np.exp(gain))
    why = (
        f"as recorded {100 * before:.0f} % of the torque of {robot.joint_names[j]} is left unexplained, whatever load, "
        f"inertias, friction and torque constant the robot has; read so, {max(100 * after, 0.1):.2g} %"
    )
    return Fault(what, why, mend)


def _advice(recording: Recording, suspect: Suspect) -> str:
    """Entries of a column map that correct the data; a torque that was computed from a current has no entry."""
    if suspect.advice:
        return suspect.advice
    if suspect.kind == "attitude":
        return f"write gravity: {suspect.entries['gravity']} into robot.yaml, if the robot is mounted so"
    taken = {f"tau.{joint}": f"{source}.{joint}" for joint, source in recording.torque_from.items()}
    if suspect.kind == "gravity":
        # Gravity is added to the torque, whatever that was computed from.
        taken = {}
    computed = [column for column in suspect.entries if taken.get(column, column) != column]
    if computed or ("tau" in suspect.entries and set(taken.values()) - set(taken)):
        columns = listed([taken[column] for column in computed] or list(dict.fromkeys(taken.values())))
        return (
            f"the torque was computed from {columns}: mend these columns with a column map (--columns), or "
            "torque_constant and gear_ratio in robot.yaml"
        )
    words = entries_words(recording, suspect.entries)
    if suspect.kind in ("factors", "gears"):
        words += (
            "; or, by the data sheet, state torque_constant and gear_ratio in robot.yaml and name the columns "
            "i.<joint>, as these factors are only as right as the masses of the model"
        )
    if suspect.kind == "time" and np.all(np.diff(recording.t) == 1.0):
        words += "; or, if t counts the rows, write ignore: [t] and rate: with the rows a second into it"
    return words
