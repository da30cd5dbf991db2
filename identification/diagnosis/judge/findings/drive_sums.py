"""What a motion shows of a drive that a voltage feeds: back-EMF, viscous friction and a late reference in one sum.

All three are torque per speed while the joint follows its reference. A recording shows their sum; each by itself only
where constants of the motor, or another gain of its loop, fix the others.
"""

from __future__ import annotations

import numpy as np

from identification.data.drives.joint_torque import per_speed
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.parameters import finding_loadings, finding_parameters
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot


def drive_sums(shown: Shown) -> tuple[Note, ...]:
    """A note on each joint with a voltage on which viscous friction or a late reference was found.

    Args:
        shown: The findings, with the fit of all their numbers.
    """
    session = shown.problem.session
    robot, recordings = session.robot, session.recordings
    out = []
    for j, joint in enumerate(robot.joint_names):
        if not recordings or any(one.torque_from.get(joint) != "u" for one in recordings):
            continue
        gains = [0.0 if one.follows is None else float(one.follows[j]) for one in recordings]
        if np.ptp(gains) > 1e-3 * max(gains):
            # Another gain makes another sum of each recording.
            continue
        per_volt_loop = gains[0]
        found, row = 0.0, np.zeros(0)
        for term in ordered(shown.named):
            per_number = _per_speed_of(robot, term, j, per_volt_loop)
            if per_number is None:
                continue
            (value,) = finding_parameters(robot, term, shown.joint_fit).values()
            assert isinstance(value.value, float)
            own = per_number * np.array(finding_loadings(robot, term, shown.joint_fit)[0])
            found, row = found + per_number * value.value, own if not row.size else row + own
        if not row.size:
            continue
        back_emf, modelled = per_speed(robot.actuators[j]), float(robot.viscous_friction[j])
        numbers = {"sum": back_emf + modelled + found, "std": float(np.linalg.norm(row)), "back_emf": back_emf}
        unit = "N s/m" if robot.prismatic[j] else "N m s/rad"
        out.append(Note(Code.DRIVE_SUM, joint, {**numbers, "unit": unit, "late": per_volt_loop > 0}))
    return tuple(out)


def _per_speed_of(robot: Robot, term: Term, row: int, gain: float) -> float | None:
    """Torque per speed of a joint by one unit of an effect's only number; None for any other effect."""
    effect, joint = term.effect, robot.joint_names[row]
    if not isinstance(effect, Effect) or term.joint not in (None, joint):
        return None
    if effect.inertial is not None or len(effect.parameters(robot, term.joint)) != 1:
        return None
    one: Float[Array, " 1"] = np.ones(1)
    late = effect.simulated(robot, term.joint, one).reference_delay
    if late is not None:
        return gain * float(late[row])
    return effect.model_numbers(robot, term.joint, one).viscous or None
