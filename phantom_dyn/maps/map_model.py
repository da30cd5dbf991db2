# pyright: reportAttributeAccessIssue=false
"""Data of a robot for a map: tip, limits, stiffness and posture, and its dynamics for a block of samples.

A map shows what a hand feels at the tip (mass, friction, stiffness) over the workspace. For built-in devices this
module adds what their robot files do not contain: inverse kinematics in closed form, published stiffness and the usual
posture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phantom_dyn._kernels import rigid_body
from phantom_dyn.array_types import Array, Float
from phantom_dyn.devices import cea, phantom
from phantom_dyn.dynamics.kinematics import frame_index
from phantom_dyn.dynamics.tree_motion import TreeMotion, project, tree_at_rest, tree_friction
from phantom_dyn.errors import ChainError, ParameterError, RobotError
from phantom_dyn.loops.solver import REACH
from phantom_dyn.model.robot import Robot, tree_position_limits
from phantom_dyn.motion import linear_joints

# Distance beyond a joint limit [rad or m] up to which a position counts as within the limit, because of rounding.
_SLACK = 1e-9
# Number of latest solutions from which the search for a single sample of a closed chain may start.
_ENDS = 4


@dataclass(frozen=True)
class MapModel:
    """A robot with tip, limits, stiffness and posture; it has ``nt`` joints in the tree, of which ``nv`` are active.

    Attributes:
        robot: The robot.
        frame: Name of the tip.
        tip: Index of this frame in the model.
        lower: Lowest position of each tree joint [rad or m], ``-inf`` without a limit, shape ``(nt,)``.
        upper: Highest position of each tree joint, ``inf`` without a limit, shape ``(nt,)``.
        stiffness: Stiffness of the active joints [N m/rad], shape ``(nv,)``; None if unknown.
        stiffness_note: Source of the stiffness, for captions.
        posture: Configuration near which a branch of the inverse kinematics is chosen, ``(nv,)``; it is also the
            position of joints that are not an axis of the grid.
        branches: Inverse kinematics in closed form: candidates ``(B, N, nv)`` for tip positions ``(N, 3)``, or None.
    """

    robot: Robot
    frame: str
    tip: int
    lower: Float[Array, " nt"]
    upper: Float[Array, " nt"]
    stiffness: Float[Array, " nv"] | None
    stiffness_note: str
    posture: Float[Array, " nv"]
    branches: Callable[[Array], Array] | None

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the active joints."""
        return self.robot.joint_names

    @property
    def nv(self) -> int:
        """Number of active joints."""
        return self.robot.nv

    @property
    def closed_numerically(self) -> bool:
        """True for a chain whose passive joints are found numerically, which takes a millisecond per sample."""
        return self.robot.chain is not None and bool(self.robot.chain.anchors)


def tree_at(model: MapModel, q: Float[Array, "N nv"]) -> TreeMotion:
    """The tree at rest at active positions [rad or m]; NaN where a chain cannot be closed."""
    return _where_closed(model.robot, q, []) if model.closed_numerically else tree_at_rest(model.robot, q)


def _where_closed(robot: Robot, q: Float[Array, "N nv"], ends: list[Float[Array, " nt"]]) -> TreeMotion:
    """The tree of a chain at rest; samples at which loops cannot be closed are NaN.

    If the solver fails for some sample of the block, each half of the block is solved by itself.

    Args:
        robot: A chain that is closed numerically.
        q: Active positions.
        ends: Last tree positions of all solved parts, to which this call adds its own; the search for a single sample
            starts at the nearest of these positions.
    """
    try:
        tree = tree_at_rest(robot, q, near=_nearest(robot, q, ends))
    except ChainError:
        if len(q) > 1:
            half = len(q) // 2
            first, second = _where_closed(robot, q[:half], ends), _where_closed(robot, q[half:], ends)
            configuration, tree_q, tree_v, tree_a, jacobian = (
                np.concatenate([getattr(first, name), getattr(second, name)])
                for name in ("configuration", "q", "v", "a", "G")
            )
            return TreeMotion(configuration, tree_q, tree_v, tree_a, jacobian)
        nt = robot.model.nv
        none = np.full((1, nt), np.nan)
        return TreeMotion(
            np.full((1, robot.nq), np.nan),
            none,
            np.zeros((1, nt)),
            np.zeros((1, nt)),
            np.full((1, nt, robot.nv), np.nan),
        )
    ends += list(tree.q[-1:])
    return tree


def _nearest(robot: Robot, q: Float[Array, "N nv"], ends: list[Float[Array, " nt"]]) -> Float[Array, " nt"] | None:
    """Start of the search for a single sample: the nearest recent solution, if one step of the solver can reach it."""
    if len(q) != 1 or not ends:
        return None
    near = ends[-_ENDS:]
    distances = [float(np.abs(x[list(robot.tree_rows)] - q[0]).max()) for x in near]
    return near[int(np.argmin(distances))] if min(distances) <= REACH else None


def within_limits(model: MapModel, q: Float[Array, "N nv"]) -> np.ndarray:
    """True where all joints of the tree are within their limits and the chain can be closed, shape ``(N,)``."""
    robot = model.robot
    inside, linear = np.ones(len(q), dtype=bool), linear_joints(robot.model)
    for joint, values in enumerate(tree_at(model, q).q.T):
        low, high = model.lower[joint] - _SLACK, model.upper[joint] + _SLACK
        if joint not in robot.tree_rows and not linear[joint] and np.isfinite(low):
            # The computed angle of a passive joint may differ by whole turns.
            values = low + np.mod(values - low, 2 * np.pi)
        inside &= (values >= low) & (values <= high)  # False for NaN
    return inside


def tip_of(model: MapModel, q: Float[Array, "N nv"]) -> tuple[Float[Array, "N 3"], Float[Array, "N 3 nv"]]:
    """Position of the tip in the root frame [m], and its translational Jacobian, at active positions."""
    tree = tree_at(model, q)
    tip, J = _tip(model, tree)
    return tip, J if model.robot.chain is None else J @ tree.G


def _tip(model: MapModel, tree: TreeMotion) -> tuple[Float[Array, "N 3"], Float[Array, "N 3 nt"]]:
    """Position of the tip [m] and its translational Jacobian by the velocities of the tree, in the axes of the root."""
    robot = model.robot
    _, tip, J = rigid_body.frame(robot.model, robot.arrays, tree.configuration, model.tip)
    return tip, J[:, :3]


@dataclass(frozen=True)
class JointSpace:
    """Jacobian, mass matrix and weight of a block of samples.

    Attributes:
        J: Translational Jacobian of the tip in the root frame, shape ``(N, 3, nv)``.
        M: Mass matrix with rotors, shape ``(N, nv, nv)``; None if it is not needed.
        weight: Torque that holds the robot against gravity, shape ``(N, nv)``; None if it is not needed.
        G: Derivative of the tree's positions by the active ones, shape ``(N, nt, nv)``.
    """

    J: Float[Array, "N 3 nv"]
    M: Float[Array, "N nv nv"] | None
    weight: Float[Array, "N nv"] | None
    G: Float[Array, "N nt nv"]


def joint_space(model: MapModel, q: Float[Array, "N nv"], *, inertia: bool) -> JointSpace:
    """Jacobian at active positions [rad or m], and mass matrix and weight if ``inertia``."""
    robot, tree = model.robot, tree_at(model, q)
    plain, J = robot.chain is None, _tip(model, tree)[1]
    J = J if plain else J @ tree.G
    if not inertia:
        return JointSpace(J, None, None, tree.G)
    mass = rigid_body.mass(robot.model, robot.arrays, tree.configuration)
    weight = rigid_body.weight(robot.model, robot.arrays, tree.configuration)
    if plain:
        return JointSpace(J, mass, weight, tree.G)
    return JointSpace(J, project(tree.G, mass) @ tree.G, project(tree.G, weight), tree.G)


def projected_friction(
    robot: Robot, G: Float[Array, "N nt nv"]
) -> tuple[Float[Array, "N nv nv"], Float[Array, "N nv"]]:
    """Viscous matrix and Coulomb torques on the active joints.

    The Coulomb torque of a passive joint is added with the sign that is worst for each active joint.
    """
    viscous, coulomb = tree_friction(robot)
    torque = np.broadcast_to(coulomb, G.shape[:2])
    if G.strides[0] == 0:
        matrix = G[0].T @ (viscous[:, None] * G[0])
        return np.broadcast_to(matrix, (len(G), *matrix.shape)), torque @ np.abs(G[0])
    return project(G, viscous[:, None] * G), project(np.abs(G), torque)


@dataclass(frozen=True)
class Device:
    """A built-in device.

    Attributes:
        branches: Function that returns candidates ``(B, N, 3)`` [rad] for tip positions ``(N, 3)`` [m], NaN for none.
        posture: Configuration that selects the branch by default [rad].
        stiffness: Function that returns the stiffness of the joints [N m/rad]; None if none is published.
        stiffness_note: Remark on the source of the stiffness, for captions.
    """

    branches: Callable[[Array], Array]
    posture: tuple[float, float, float]
    stiffness: Callable[[], Array] | None = None
    stiffness_note: str = ""


def phantom_branches(p: Array) -> Array:
    """One candidate, because the parallelogram allows only one assembly."""
    return phantom.inverse_kinematics(p)[None]


def cea_branches(p: Array) -> Array:
    """Four candidates: the arm on each side of the axis of q1, with the elbow on each side.

    In the plane of the arm, q2 and q5 are absolute, so that ``(rho, -z) = d3 (cos q2, sin q2) + d4 (cos q5, sin q5)``.
    """
    d3, d4 = cea.LENGTHS.d3, cea.LENGTHS.d4
    out = []
    for side in (1.0, -1.0):
        rho, depth = side * np.hypot(p[:, 0], p[:, 1]), -p[:, 2]
        turn = np.arctan2(side * p[:, 1], side * p[:, 0])
        square = rho**2 + depth**2
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.arccos((square - d3**2 - d4**2) / (2 * d3 * d4))
        for elbow in (apart, -apart):
            q2 = np.arctan2(depth, rho) - np.arctan2(d4 * np.sin(elbow), d3 + d4 * np.cos(elbow))
            out.append(np.stack([turn, q2, q2 + elbow], axis=-1))
    return np.stack(out)


DEVICES = {
    "phantom_1_5": Device(branches=phantom_branches, posture=(0.0, 0.0, 0.0)),
    "cea_branch": Device(
        branches=cea_branches,
        posture=(0.0, -np.pi / 4, np.pi / 4),
        stiffness=cea.joint_stiffness,
        stiffness_note="joint stiffness 1000 N m/rad: the source's 1 N m/rad, read in N m/mrad (as printed it gives a "
        "few N/m, against the published 2000 to 5000 N/m)",
    ),
}


def map_model(
    robot: Robot,
    *,
    frame: str | None = None,
    stiffness: Float[Array, " nv"] | None = None,
    posture: Float[Array, " nv"] | None = None,
) -> MapModel:
    """A robot with the tip, limits, stiffness and posture of a map.

    Args:
        robot: The robot.
        frame: Name of the tip; by default ``tip`` if the robot has such a frame, otherwise its last frame.
        stiffness: Stiffness of each joint [N m/rad]; by default the published one of a built-in device, or the position
            gain ``kp`` of the controllers in ``robot.yaml``, or none.
        posture: Configuration [rad or m] near which a branch is chosen; by default that of a built-in device, the start
            of a numerically closed chain, or zero; for a joint that cannot reach zero, the middle of its range.

    Raises:
        RobotError: If the robot has no such frame, or the frame does not move.
        ParameterError: If stiffness or posture do not fit the robot.
    """
    model = robot.model
    chosen = _frame(robot, frame)
    joint = model.frames[chosen].parentJoint
    if joint == 0:
        raise RobotError(f"The frame {model.frames[chosen].name!r} of {robot.name} does not move: name a moving one.")
    name = model.frames[chosen].name
    device = DEVICES.get(robot.source) if name == "tip" else None
    lower, upper = tree_position_limits(robot.model)
    stiff, note = _stiffness(robot, device, stiffness)
    active = list(robot.tree_rows)
    return MapModel(
        robot=robot,
        frame=name,
        tip=chosen,
        lower=lower,
        upper=upper,
        stiffness=stiff,
        stiffness_note=note,
        posture=_posture(robot, device, posture, lower[active], upper[active]),
        branches=None if device is None else device.branches,
    )


def _frame(robot: Robot, frame: str | None) -> int:
    """Index of the named frame; by default of ``tip``, or of the last frame."""
    if frame is not None:
        return frame_index(robot, frame)
    return robot.model.getFrameId("tip") if robot.model.existFrame("tip") else len(robot.model.frames) - 1


def _stiffness(robot: Robot, device: Device | None, given: Array | None) -> tuple[Array | None, str]:
    """Stiffness of the joints [N m/rad], None if nothing states it, and its source in words."""
    if given is not None:
        if given.shape != (robot.nv,) or not (np.isfinite(given).all() and (given > 0).all()):
            raise ParameterError(
                f"The stiffness {np.array2string(given, separator=', ')} does not fit {robot.name}: give one number "
                f"above 0 for each of {', '.join(robot.joint_names)}."
            )
        return given, f"joint stiffness as given, {_numbers(given)} N m/rad"
    if device is not None and device.stiffness is not None:
        return device.stiffness(), device.stiffness_note
    gains = [actuator.controller.kp if actuator.controller else 0.0 for actuator in robot.actuators]
    if all(gain > 0 for gain in gains):
        return np.array(gains), f"joint stiffness from the controllers' kp, {_numbers(np.array(gains))} N m/rad"
    return None, ""


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _posture(robot: Robot, device: Device | None, given: Array | None, lower: Array, upper: Array) -> Array:
    """The posture of `map_model` [rad or m], shape ``(nv,)``."""
    if given is not None:
        if given.shape != (robot.nv,) or not np.isfinite(given).all():
            raise ParameterError(
                f"The configuration {np.array2string(given, separator=', ')} does not fit {robot.name}: give one "
                f"number for each of {', '.join(robot.joint_names)}."
            )
        return given
    if device is not None:
        return np.array(device.posture)
    if robot.chain is not None and robot.chain.anchors:
        return robot.chain.start[list(robot.chain.active)]
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2
    middle_or_limit = np.where(bounded, middle, np.clip(0.0, lower, upper))
    return np.where((lower <= 0) & (upper >= 0), 0.0, middle_or_limit)
