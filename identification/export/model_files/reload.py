# pyright: reportAttributeAccessIssue=false
"""Loads written models again, and compares their torques with those of the models that they were made from.

If MuJoCo is broken or too old, it is not used, as if it were not installed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from identification.export.model_files.tree import tree_torque, with_tree_friction
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import TreeMotion, tree_friction, tree_motion
from phantom_dyn.errors import PhantomDynError, RobotError
from phantom_dyn.model.files.plain_file import unnamed_file
from phantom_dyn.model.files.settings_file import load_mapping
from phantom_dyn.model.files.strict_yaml import settings_text
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.ros2_control import is_ros2_control
from phantom_dyn.motion import Motion, configurations

OLDEST = (3, 4)
"""Oldest version of MuJoCo that has all functions needed to load a file again."""

_JOINT = '<worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>'
_NEWER = (
    (
        "<dcmotor",
        '<dcmotor joint="j" motorconst="1e-9 0" resistance="1" cogging="0 1 0" ctrlrange="0 0"/>',
        "<dcmotor>",
    ),
    (" delay=", '<motor joint="j" delay="0.01" nsample="12" interp="linear"/>', "delay of an actuator"),
)
"""Features of newer versions of MuJoCo: text that shows their use, an actuator with the feature, and its name."""


def mujoco_problem(text: str = "") -> str | None:
    """Why MuJoCo cannot load a file again, as the end of a sentence; None if it can.

    Args:
        text: Text of the MJCF, which may have elements that only newer versions read.
    """
    try:
        import mujoco
    except Exception as error:  # a library of the system that is missing raises OSError, a half installation anything
        return f"MuJoCo cannot be imported ({' '.join(str(error).split())})"
    version = str(getattr(mujoco, "__version__", "0"))
    if not hasattr(mujoco, "MjModel") or _numbers(version) < OLDEST:
        return f"MuJoCo {version} is older than 3.4 (pip install --upgrade mujoco)"
    for words, actuator, name in _NEWER:
        if words in text:
            try:
                mujoco.MjModel.from_xml_string(f"<mujoco>{_JOINT}<actuator>{actuator}</actuator></mujoco>")
            except ValueError:
                return f"MuJoCo {version} does not know the {name} in it (pip install --upgrade mujoco)"
    return None


def _numbers(version: str) -> tuple[int, ...]:
    """The first two numbers of a version."""
    parts = [*version.split("."), "0"][:2]
    return tuple(int(part) if part.isdigit() else 0 for part in parts)


TOLERANCE = 1e-6
"""Largest accepted difference of torques over the largest torque. Files have all digits, so more is a mistake."""


def urdf_difference(text: str, robot: Robot, motion: Motion, config: Path | None) -> float:
    """Largest difference of torques, over the largest torque, of a URDF that Pinocchio has loaded again.

    All joints of the tree are compared, as if each had a drive: a URDF has no loops.

    Args:
        text: Text of the URDF.
        robot: The model in the file; rotor inertias are taken from it, as a URDF has none.
        motion: N samples of the active joints.
        config: The robot's ``robot.yaml``, for locked joints and gravity.

    Raises:
        RobotError: If the text cannot be loaded, or has other joints.
    """
    tree = tree_motion(robot, motion)
    loaded = robot_with_urdf(text, robot, config)
    again = replace(tree, configuration=configurations(loaded.model, tree.q))
    return relative_difference(tree_torque(loaded, again), tree_torque(robot, tree))


def robot_with_urdf(text: str, robot: Robot, config: Path | None) -> Robot:
    """A robot with the links, joints and friction of a URDF that Pinocchio has loaded.

    Args:
        text: Text of the URDF.
        robot: The robot with all that a URDF lacks: rotor inertias, gravity, loops and drives.
        config: The robot's ``robot.yaml``, for locked joints.

    Raises:
        RobotError: If the text cannot be loaded, or has other joints.
    """
    loaded = loaded_urdf(text, config)
    if list(loaded.model.names) != list(robot.model.names):
        raise RobotError(
            f"The URDF that was written has the joints {', '.join(list(loaded.model.names)[1:])}, wanted "
            f"{', '.join(list(robot.model.names)[1:])}: this is an error of phantom-dyn."
        )
    model = loaded.model.copy()
    model.armature, model.gravity = robot.model.armature, robot.model.gravity
    return replace(with_tree_friction(robot, *tree_friction(loaded)), model=model)


def loaded_urdf(text: str, config: Path | None) -> Robot:
    """The robot of a URDF that was written.

    Args:
        text: Text of the URDF.
        config: The ``robot.yaml`` of the given robot, which may lock joints that this URDF does not have.

    Raises:
        RobotError: If the text cannot be loaded.
    """
    with unnamed_file(text.encode(), suffix=".urdf") as path, _config_for(text, config) as stated:
        try:
            return load_robot(path, config=stated)
        except PhantomDynError as error:
            words = str(error).replace(str(path), "the URDF that was written")
            raise RobotError(words if stated is config else words.replace(str(stated), str(config))) from error


@contextmanager
def _config_for(text: str, config: Path | None) -> Iterator[Path | None]:
    """A ``robot.yaml`` without entries on joints that a URDF does not have.

    A URDF that is made from an MJCF has no joints that were held fixed.
    """
    content = {} if config is None else load_mapping(config, RobotError)
    there = {joint.get("name") for joint in ElementTree.fromstring(text.encode()).findall("joint")}
    lock, joints = content.get("lock") or [], content.get("joints") or {}
    if is_ros2_control(content) or (there.issuperset(lock) and there.issuperset(joints)):
        yield config
        return
    kept = {name: keys for name, keys in joints.items() if name in there}
    left = {**content, "lock": [name for name in lock if name in there], "joints": kept}
    with unnamed_file(settings_text(left).encode(), suffix=".yaml") as path:
        yield path


def mujoco_difference(text: str, robot: Robot, motion: Motion) -> float:
    """Largest difference of torques, over the largest torque, of an MJCF loaded again; NaN without MuJoCo.

    Args:
        text: Text of the MJCF.
        robot: The model in the file.
        motion: N samples of the active joints.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    if mujoco_problem(text) is not None:
        return float("nan")
    tree = tree_motion(robot, motion)
    return relative_difference(mujoco_torque(text, robot, tree), tree_torque(robot, tree))


def mujoco_torque(text: str, robot: Robot, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Torque [N m or N] on every joint of the tree that an MJCF needs in MuJoCo, less that of drives without a command.

    Args:
        text: Text of the MJCF; joints that the robot does not have stay at zero.
        robot: The robot with the joints.
        tree: N samples of the motion of all joints.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    return torque_of_mujoco(load_mujoco(text), robot, tree, {})


def torque_of_mujoco(model: Any, robot: Robot, tree: TreeMotion, held: Mapping[str, float]) -> Float[Array, "N nt"]:
    """`mujoco_torque` of a loaded model.

    Args:
        model: MuJoCo's model; its constraints are switched off.
        robot: The robot with the joints.
        tree: N samples of the motion of all joints.
        held: Positions of joints that the robot does not have, if they are not zero.
    """
    import mujoco

    # Loops and dry friction are constraints. Without constraints the torque is that of the tree; friction is added.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    places, order = mujoco_joints(model, robot)
    out = np.empty_like(tree.v)
    for k, (q, v, a) in enumerate(zip(tree.q, tree.v, tree.a, strict=True)):
        # A floating base is kept at rest and upright.
        for values, own, at in ((data.qpos, q, places), (data.qvel, v, order), (data.qacc, a, order)):
            values[:] = 0.0
            values[at] = own
        for name, position in held.items():
            data.qpos[model.joint(name).qposadr[0]] = position
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse[order]
        data.ctrl[:] = 0.0
        mujoco.mj_fwdActuation(model, data)
        out[k] -= data.qfrc_actuator[order]
    return out + model.dof_frictionloss[order] * np.sign(tree.v)


def load_mujoco(text: str) -> Any:
    """MuJoCo's model of an MJCF.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    import mujoco

    try:
        return mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise RobotError(f"MuJoCo refuses the MJCF that was written ({' '.join(str(error).split())}).") from error


def mujoco_joints(model: Any, robot: Robot) -> tuple[list[int], list[int]]:
    """MuJoCo's index of position and velocity of each joint of the robot's tree."""
    import mujoco

    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(model.njnt)]
    joints = [names.index(name) for name in list(robot.model.names)[1:]]
    return model.jnt_qposadr[joints].tolist(), model.jnt_dofadr[joints].tolist()


def some_motion(motion: Motion, most: int = 200) -> Motion:
    """At most this number of samples of a motion, evenly spread."""
    return motion.at(np.unique(np.linspace(0, len(motion.t) - 1, most).astype(int)))


def versions() -> dict[str, str]:
    """Name and version of the libraries that load the files again, by format; MuJoCo only if it is installed."""
    out = {"urdf": f"Pinocchio {pin.__version__}"}
    if mujoco_problem() is None:
        import mujoco

        out["mjcf"] = f"MuJoCo {mujoco.__version__}"
    return out


def relative_difference(found: Float[Array, "N nt"], wanted: Float[Array, "N nt"]) -> float:
    """Largest difference of torques, over the largest expected torque."""
    largest = float(np.abs(wanted).max())
    return float(np.abs(found - wanted).max() / (largest if largest > 0 else 1.0))
