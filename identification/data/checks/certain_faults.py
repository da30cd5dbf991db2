# pyright: reportAttributeAccessIssue=false
"""Finds certain faults of a recording or of the model, with which a diagnosis would be meaningless.

A fault is certain if no plausible robot explains the data as recorded, but a plausible robot explains the data in
another unit, with another sign or in another order (`identification.data.checks.better_readings`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from identification.data.checks.better_readings import better_readings
from identification.data.checks.exchanged_columns import exchanged_columns
from identification.data.checks.model_units import wrong_units
from identification.data.checks.readings.plausible_fit import AS_MODELLED, ENOUGH
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.reading_fits import ReadingFit, explains_nearly_all
from identification.data.checks.readings.suspects import Suspect, highest_speed
from identification.data.checks.torques.missing_torques import missing_torque
from identification.data.checks.torques.torque_factors import factor_suspects
from identification.data.checks.torques.torque_scales import load_or_current, torque_scales
from identification.data.checks.torques.unsigned_torques import unsigned_fault
from identification.data.readers.map_entries import entries_after, entries_words
from identification.data.recording import Fault, Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction, standard_parameters
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Largest number of joints: with more, the fits of all units, signs and orders would take longer than a diagnosis.
_MOST_JOINTS = 12


def massless_model(robot: Robot) -> tuple[Fault, ...]:
    """The fault of a model without mass or inertia in any link; a single joint may have only a rotor."""
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
    """Certain faults of a recording or of the model, and sentences on possible mistakes that are not certain.

    Args:
        recording: Raw samples.
        robot: The given model.
        reading: Smoothed samples of the recording; None if there is no torque to compare with the model.
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
    wrong = _with_entries_of_all([one for one in found if one.suspect.outcome == "wrong"])
    faults = tuple(_fault(recording, robot, reading, one) for one in wrong)
    # Mistakes that are possible but not certain, such as gravity subtracted by a controller.
    possible = (one.suspect for one in found if one.suspect.outcome == "offer")
    offers = tuple(f"{recording.file}: {suspect.what}: {_advice(recording, suspect)}." for suspect in possible)
    # Corrections are found one after the other, so the last fit has all of them. If a part of the torque is unexplained
    # even then, no correction is certain, unless one was very likely before any fit (`expected`). The corrections are
    # then only offered.
    if wrong and not (any(one.suspect.expected for one in wrong) or explains_nearly_all(wrong[-1])):
        return (), offers + _uncertain(recording, robot, faults, wrong[-1])
    return faults, offers


def _with_entries_of_all(wrong: Sequence[ReadingFit]) -> list[ReadingFit]:
    """The mistakes in the same order, each with entries that also contain earlier corrections of the same columns."""
    out: list[ReadingFit] = []
    earlier: dict[str, str] = {}
    for one in wrong:
        suspect, *twins = (replace(x, entries=entries_after(earlier, x.entries)) for x in (one.suspect, *one.twins))
        out.append(replace(one, suspect=suspect, twins=tuple(twins)))
        earlier |= suspect.entries
    return out


def _uncertain(recording: Recording, robot: Robot, faults: tuple[Fault, ...], last: ReadingFit) -> tuple[str, ...]:
    """Sentences on faults that are not certain, because their correction leaves a part of the torque unexplained.

    Args:
        recording: The recording.
        robot: The given model.
        faults: Faults whose corrections are only offered.
        last: Fit with all faults corrected.
    """
    j = int(np.nanargmax(np.nanmax(last.unexplained, axis=0)))
    share = float(np.nanmax(last.unexplained[:, j]))
    left_over = f"{100 * share:.2g} % of the torque of {robot.joint_names[j]} are left then"
    return tuple(
        f"{recording.file}: it may be that {fault.what} ({fault.why}): {fault.mend}; but {left_over}, so that there is "
        "another mistake, or this is none."
        for fault in faults
    )


def load_or_current_words(recording: Recording, robot: Robot, reading: Reading | None) -> tuple[str, ...]:
    """Sentence on torques that differ from the modelled ones by large factors; empty without such torques.

    The torques may be motor currents or voltages, or the robot may carry a load that the model lacks. Torques that were
    computed from another quantity are not checked.

    Args:
        recording: The recording.
        robot: The given model.
        reading: Smoothed samples of the recording; None if there is no torque to compare with the model.
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


def _fault(recording: Recording, robot: Robot, reading: Reading, found: ReadingFit) -> Fault:
    """The fault that a reading corrects, with evidence and advice."""
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
    j = int(np.nanargmax(found.joint_gains))
    # A gain is the logarithm of (unexplained before + ENOUGH) over (unexplained after + ENOUGH).
    after, gain = np.nanmax(found.unexplained[:, j]), found.joint_gains[j]
    before = min(1.0, (after + ENOUGH) * np.exp(gain))
    robots = (
        "unless inertias or torque constants are far from the model's"
        if found.freedom == AS_MODELLED
        else "whatever load, inertias, friction and torque constant the robot has"
    )
    why = (
        f"as recorded {100 * before:.0f} % of the torque of {robot.joint_names[j]} is left unexplained, {robots}; "
        f"read so, {max(100 * after, 0.1):.2g} %"
    )
    return Fault(what, why, mend)


def _advice(recording: Recording, suspect: Suspect) -> str:
    """Advice on how to correct the data: mostly entries of a column map.

    There is no entry for a torque that was computed from another quantity, such as a current.
    """
    if suspect.advice:
        return suspect.advice
    if suspect.kind == "attitude":
        return f"write gravity: {suspect.entries['gravity']} into robot.yaml, if the robot is mounted so"
    sources = {f"tau.{joint}": f"{source}.{joint}" for joint, source in recording.torque_from.items()}
    if suspect.kind == "gravity":
        # Gravity is added to the torque itself, even if the torque was computed from a current.
        sources = {}
    computed = [column for column in suspect.entries if sources.get(column, column) != column]
    any_computed = any(source != column for column, source in sources.items())
    if computed or ("tau" in suspect.entries and any_computed):
        columns = listed([sources[column] for column in computed] or list(dict.fromkeys(sources.values())))
        return (
            f"the torque was computed from {columns}: mend these columns with a column map (--columns), or "
            "torque_constant and gear_ratio in robot.yaml"
        )
    words = entries_words(recording, suspect.entries)
    if suspect.kind == "gravity":
        words = (
            f"if a controller had taken gravity out, {words}; if the robot stands or hangs otherwise, state gravity in "
            "robot.yaml"
            if "tau" in suspect.entries
            else f"if a controller had taken gravity out there, or a counterbalance carries the links, {words}"
        )
    if suspect.kind in ("factors", "gears"):
        words += (
            "; or, by the data sheet, state torque_constant and gear_ratio in robot.yaml and name the columns "
            "i.<joint>, as these factors are only as right as the masses of the model"
        )
    if suspect.kind == "time" and np.all(np.diff(recording.t) == 1.0):
        words += "; or, if t only counts the rows, write ignore: [t] and rate: <rows per second> into the column map"
    return words
