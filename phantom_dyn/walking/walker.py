# pyright: reportAttributeAccessIssue=false
"""A biped robot: a floating-base model, its soles, and a standing posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.errors import RobotError, known_names
from phantom_dyn.model.loading import parsed_urdf
from phantom_dyn.model.robot_files import find_robot


@dataclass(frozen=True)
class Sole:
    """Contact area of a foot, a rectangle or trapezium [m] in a frame of the robot with x forward and z up.

    Attributes:
        frame: Name of the frame.
        front: x of the front edge.
        back: x of the back edge.
        half_width_front: Half the length of the front edge.
        half_width_back: Half the length of the back edge.
        below: Height of the frame above the ground.
    """

    frame: str
    front: float
    back: float
    half_width_front: float
    half_width_back: float
    below: float

    @property
    def middle(self) -> Float[Array, " 3"]:
        """Middle of the sole in the frame [m], shape ``(3,)``."""
        return np.array([(self.front + self.back) / 2, 0.0, -self.below])

    @property
    def corners(self) -> Float[Array, "4 2"]:
        """Corners about the middle [m], counter-clockwise from above, shape ``(4, 2)``."""
        half = (self.front - self.back) / 2
        front, back = self.half_width_front, self.half_width_back
        return np.array([[half, -front], [half, front], [-half, back], [-half, -back]])


@dataclass(frozen=True)
class Walker:
    """A biped with its soles and its posture.

    Attributes:
        model: Private copy with a free-flyer and the added frames ``left_sole`` and ``right_sole``.
        corners: Corners of each sole relative to its middle [m], shape ``(4, 2)``.
        posture: Configuration with bent legs and both soles level on the ground, shape ``(nq,)``.
        leg_columns: Indices of the velocities of the base and both legs, 18 of them.
        foot_distance: Distance between the middles of the soles in the posture [m].
        com_height: Height of the centre of mass above the soles in the posture [m].
    """

    model: pin.Model
    corners: Float[Array, "4 2"]
    posture: Float[Array, " nq"]
    leg_columns: tuple[int, ...]
    foot_distance: float
    com_height: float

    def __post_init__(self):
        object.__setattr__(self, "model", self.model.copy())
        object.__setattr__(self, "corners", read_only(self.corners))
        object.__setattr__(self, "posture", read_only(self.posture))

    def corners_at(self, foot: Float[Array, " 4"]) -> Float[Array, "4 3"]:
        """Corners of a sole in the world [m], shape ``(4, 3)``, from x, y, z of its middle and its heading."""
        cosine, sine = np.cos(foot[3]), np.sin(foot[3])
        turned = self.corners @ np.array([[cosine, sine], [-sine, cosine]])
        return np.column_stack([turned + foot[:2], np.full(len(turned), foot[2])])


def load_walker(source: str | Path, *, left: Sole, right: Sole, posture: Mapping[str, float]) -> Walker:
    """Load a biped from a URDF.

    Args:
        source: File, or ``example:NAME``.
        left: Sole of the left foot.
        right: Sole of the right foot, of the same shape.
        posture: Joint positions [rad] with bent legs and level soles; other joints are at zero.

    Raises:
        RobotError: If the file cannot be used or lacks a frame or joint, the soles are not level side by side in the
            posture, or a leg does not have six joints.
    """
    path = find_robot(source)
    parsed_urdf(path)  # raises a clear error if the file is faulty
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    q = pin.neutral(model)
    for joint, value in posture.items():
        if not model.existJointName(joint):
            known = known_names(joint, list(model.names)[2:], "joints")
            raise RobotError(f"{path}: the posture names the unknown joint {joint!r}, {known}")
        q[model.joints[model.getJointId(joint)].idx_q] = value
    columns = list(range(6))
    for side, sole in (("left", left), ("right", right)):
        columns += _add_sole(model, f"{side}_sole", sole, path)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    left_at, right_at = (data.oMf[model.getFrameId(f"{side}_sole")] for side in ("left", "right"))
    between = left_at.translation - right_at.translation
    tilt = max(abs(pose.rotation - np.eye(3)).max() for pose in (left_at, right_at))
    # The limits allow for a rounded posture: a tenth of a degree and half a millimetre.
    if tilt > 2e-3 or abs(between[[0, 2]]).max() > 5e-4 or between[1] <= 0:
        raise RobotError(
            f"{path}: in the posture the soles are not level side by side: the left one is at "
            f"({between[0]:.4f}, {between[1]:.4f}, {between[2]:.4f}) m from the right one, and a sole is tilted by "
            f"{tilt:.4f} rad: correct the posture."
        )
    middle = (left_at.translation + right_at.translation) / 2
    q[:3] -= middle
    com = pin.centerOfMass(model, data, q)
    return Walker(model, left.corners, q, tuple(columns), float(between[1]), float(com[2]))


def _add_sole(model: pin.Model, name: str, sole: Sole, path: Path) -> list[int]:
    """Add the frame of a sole to the model, and return the velocity indices of the joints that carry it."""
    if not model.existFrame(sole.frame):
        known = known_names(sole.frame, dict.fromkeys(frame.name for frame in model.frames), "frames")
        raise RobotError(f"{path}: a sole names the unknown frame {sole.frame!r}, {known}")
    index = model.getFrameId(sole.frame)
    frame = model.frames[index]
    placement = frame.placement * pin.SE3(np.eye(3), sole.middle)
    model.addFrame(pin.Frame(name, frame.parentJoint, index, placement, pin.FrameType.OP_FRAME))
    chain = [joint for joint in model.supports[frame.parentJoint] if joint > 1]
    if len(chain) != 6 or any(model.joints[joint].nv != 1 for joint in chain):
        raise RobotError(f"{path}: the leg to {sole.frame!r} has {len(chain)} joints, and walking needs six: give one.")
    return [model.joints[joint].idx_v for joint in chain]


def _mirrored(joints: dict[str, float]) -> Mapping[str, float]:
    return MappingProxyType(joints | {name.replace("left", "right"): value for name, value in joints.items()})


TALOS_SOLE = Sole("left_sole_link", 0.10, -0.10, 0.06, 0.06, 0.0)
"""TALOS: a rectangle inside the flat part of its foot's collision mesh."""
TALOS_POSTURE = _mirrored(
    {"leg_left_3_joint": -0.411354, "leg_left_4_joint": 0.859395, "leg_left_5_joint": -0.448041}
    | {"arm_left_4_joint": -0.525366, "arm_left_7_joint": 0.1}
)
"""TALOS: legs, elbows and wrists as in the state ``half_sitting`` of its SRDF."""

TALOS_BENT = MappingProxyType(
    dict(TALOS_POSTURE)
    | {
        f"leg_{side}_{joint}_joint": value
        for side in ("left", "right")
        for joint, value in ((3, -0.6), (4, 1.2), (5, -0.6))
    }
)
"""TALOS with more bent knees for stairs, so that the rear leg reaches one step down."""

G1_SOLE = Sole("left_ankle_roll_link", 0.12, -0.05, 0.03, 0.025, 0.035)
"""Unitree G1: the lowest points of the four contact spheres in its URDF."""
G1_POSTURE = _mirrored(
    {"left_hip_pitch_joint": -0.4, "left_knee_joint": 0.8, "left_ankle_pitch_joint": -0.4, "left_elbow_joint": 1.0}
)
"""Unitree G1: knees and elbows bent."""


def talos() -> Walker:
    """TALOS of example-robot-data: 90 kg, soles of 20 x 12 cm."""
    return _example("talos_reduced", TALOS_SOLE, "right_sole_link", TALOS_POSTURE)


def talos_bent() -> Walker:
    """TALOS with knees bent for stairs; its centre of mass is 83 cm above the soles."""
    return _example("talos_reduced", TALOS_SOLE, "right_sole_link", TALOS_BENT)


def g1() -> Walker:
    """Unitree G1 of example-robot-data: 33 kg, soles of 17 x 6 cm."""
    return _example("g1_29dof_rev_1_0", G1_SOLE, "right_ankle_roll_link", G1_POSTURE)


def _example(stem: str, left: Sole, right_frame: str, posture: Mapping[str, float]) -> Walker:
    right = Sole(right_frame, left.front, left.back, left.half_width_front, left.half_width_back, left.below)
    return load_walker(f"example:{stem}", left=left, right=right, posture=posture)
