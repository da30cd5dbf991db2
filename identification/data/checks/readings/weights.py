"""Suspected mistakes in gravity: a controller subtracted the weight, or the base is mounted in another way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.data.checks.readings.reading import Reading, varies, with_torques_plus
from identification.data.checks.readings.suspects import Suspect, names
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, modelled_friction
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.model.robot import Robot

# The weight of a link is visible in a torque if its standard deviation is above this share of the torque's.
_MATTERS = 0.2
# Torques contain the weight if the gravity that is estimated from them is above this share of the true gravity. Wrong
# torque constants may halve the estimate.
_CONTAINED = 0.3
# The torque of a single joint lacks all weight if the gravity that it shows is at most the first share of the true one,
# and contains the weight if it is at least the second.
_NONE, _HALF = 0.1, 0.5
# The base is mounted in another way if the cosine between estimated and given gravity is at most the first number; the
# diagnosis finds smaller tilts. The estimate is along an axis if the cosine between them is above the second number.
_UPRIGHT, _ALONG = float(np.cos(np.radians(40.0))), float(np.cos(np.radians(10.0)))


def compensated_suspects(robot: Robot, reading: Reading, *, loaded: bool = False) -> list[Suspect]:
    """The suspected mistake that a controller subtracted the weight of the links from all or some torques.

    Args:
        robot: The given model.
        reading: The data as recorded.
        loaded: True if the robot may carry a load that the model lacks, whose weight was not subtracted.
    """
    weight = gravity_torque(robot, reading.motion.q)
    matters = weight.std(axis=0) > _MATTERS * reading.tau.std(axis=0)
    # The constant torque of a joint at rest does not show whether its weight was subtracted or a brake bears it.
    joints = tuple(np.flatnonzero(matters & varies(reading.tau)).tolist())
    size = float(np.linalg.norm(robot.model.gravity.linear))

    def felt(some: Sequence[int]) -> float:
        """Gravity that the torques of some joints together show, as a share of the model's."""
        return float(np.linalg.norm(gravity_from_torques(robot, reading, some))) / size

    if not joints or size == 0.0:
        return []
    without = joints
    if not loaded:
        each = {j: felt((j,)) for j in joints}
        lacking = tuple(j for j in joints if each[j] <= _NONE)
        if lacking and all(each[j] >= _HALF for j in joints if j not in lacking):
            # Other torques contain their weight: a controller or a counterbalance carries that of these joints alone.
            without = lacking
    if without == joints and felt(joints) > (1.0 if loaded else _CONTAINED):
        return []
    entries = {"tau": "{compensated: gravity}"}
    if without != joints:
        entries = {f"tau.{robot.joint_names[j]}": "{compensated: gravity}" for j in without}
        weight = np.where(np.isin(np.arange(robot.nv), without), weight, 0.0)
    several = len(without) > 1
    lacks = "may lack" if loaded else "lack" if several else "lacks"
    return [
        Suspect(
            "gravity",
            without,
            f"the torque{'s' * several} of {names(robot, without)} {lacks} the weight of the links that the model has",
            entries,
            lambda reading: with_torques_plus(reading, weight),
            outcome="offer" if loaded else "wrong",
        )
    ]


def attitude_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistakes that the base is mounted in another way, as on a wall, or that gravity has a wrong size.

    The direction of gravity is estimated from the torques. A load that the model lacks turns the estimate, so that
    gravity is first tried along the nearest axis of the base. If the estimate is not near this axis, gravity is also
    tried along the estimate. Its size is always 9.81 m/s^2, because that of the estimate depends on the masses.
    """
    given = np.array(robot.model.gravity.linear)
    size = float(np.linalg.norm(robot.model.gravity981))
    joints = tuple(np.flatnonzero(varies(reading.tau)).tolist())
    if not joints:
        return []
    estimate = gravity_from_torques(robot, reading, joints)
    length = float(np.linalg.norm(estimate))
    if length <= _CONTAINED * size:
        return []
    if estimate @ given > _UPRIGHT * length * np.linalg.norm(given):
        return _other_gravity(robot, reading, joints, size * given / np.linalg.norm(given))
    nearest = np.argmax(np.abs(estimate))
    axis = np.eye(3)[nearest] * np.sign(estimate[nearest])
    directions = [axis] if estimate @ axis > _ALONG * length else [axis, estimate / length]
    tried = [size * direction for direction in directions if direction @ given <= _UPRIGHT * np.linalg.norm(given)]
    return [suspect for gravity in tried for suspect in _other_gravity(robot, reading, joints, gravity)]


def _other_gravity(robot: Robot, reading: Reading, joints: Sequence[int], gravity: Float[Array, " 3"]) -> list[Suspect]:
    """The suspected mistake that gravity is not as the model states; empty if no torque would show the difference.

    Args:
        robot: The given model.
        reading: The data as recorded.
        joints: Joints whose torque varies.
        gravity: The suspected gravity [m/s^2] in the axes of the base.
    """
    given = np.array(robot.model.gravity.linear)
    change = gravity_torque(robot, reading.motion.q, gravity - given)
    visible = tuple(j for j in joints if change[:, j].std() > _MATTERS * reading.tau[:, j].std())
    if not visible:
        return []
    what = "the base is mounted in another way than gravity in the model says"
    if not given.any():
        what = "the model has no gravity, but the torques contain the weight of the links"
    elif np.allclose(np.cross(gravity, given), 0.0) and gravity @ given > 0.0:
        what = f"gravity is {np.linalg.norm(given):.3g} m/s^2 in the model, but 9.81 m/s^2 in the torques"
    return [
        Suspect(
            "attitude",
            visible,
            what,
            {"gravity": f"[{', '.join(f'{x:.3g}' for x in gravity + 0.0)}]"},
            lambda reading: reading,
            model=with_gravity(robot, gravity),
        )
    ]


def gravity_from_torques(robot: Robot, reading: Reading, joints: Sequence[int]) -> Float[Array, " 3"]:
    """Gravity [m/s^2] in the axes of the base, estimated from the torques of some joints.

    All these torques are fitted together by least squares. Gravity is common to all joints. Each joint has its own
    coefficients for the inertial torque of its links, viscous and Coulomb friction, and an offset.
    """
    per_axis = np.stack([gravity_torque(robot, reading.motion.q, axis) for axis in np.eye(3)], axis=2)
    moving = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    moving = moving - gravity_torque(robot, reading.motion.q)
    n, count = len(moving), len(joints)
    columns, torques = np.zeros((n * count, 3 + 4 * count)), np.zeros(n * count)
    for k, j in enumerate(joints):
        size, rows = reading.tau[:, j].std(), slice(k * n, (k + 1) * n)
        of_joint = np.column_stack([moving[:, j], reading.motion.v[:, j], reading.sign[:, j], np.ones(n)])
        columns[rows, :3], columns[rows, 3 + 4 * k : 7 + 4 * k] = per_axis[:, j] / size, of_joint / size
        torques[rows] = (reading.tau[:, j] + reading.external[:, j]) / size
    return np.linalg.lstsq(columns, torques, rcond=1e-6)[0][:3]
