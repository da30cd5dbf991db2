# pyright: reportAttributeAccessIssue=false
"""Loads written models again, and compares their torques with those of the models in memory.

A broken MuJoCo counts as not installed.
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

_JOINT = '<worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>'
_NEWER = (
    (
        "<dcmotor",
        '<dcmotor joint="j" motorconst="1e-9 0" resistance="1" cogging="0 1 0" ctrlrange="0 0"/>',
        "<dcmotor>",
    ),
    (" delay=", '<motor joint="j" delay="0.01" nsample="12" interp="linear"/>', "delay of an actuator"),
)
"""Features that only newer versions of MuJoCo have: text in files that use the feature, a test actuator, and a name."""


def mujoco_problem(text: str = "") -> str | None:
    """The reason why MuJoCo cannot be used, as the end of a sentence; None if MuJoCo can be used.

    Args:
        text: Text of the MJCF to load, to test whether this version of MuJoCo has all features that the MJCF uses.
    """
    try:
        import mujoco
    except Exception as error:  # a missing system library raises OSError; a broken installation can raise any error
        return f"MuJoCo cannot be imported ({' '.join(str(error).split())})"
    for words, actuator, name in _NEWER:
        if words in text:
            try:
                mujoco.MjModel.from_xml_string(f"<mujoco>{_JOINT}<actuator>{actuator}</actuator></mujoco>")
            except ValueError:
                return f"MuJoCo {mujoco.__version__} does not know the {name} in it (pip install --upgrade mujoco)"
    return None


TOLERANCE = 1e-6
"""Largest accepted torque difference, divided by the largest torque. Files have all digits, so more means a bug."""


def urdf_difference(text: str, robot: Robot, motion: Motion, config: Path | None) -> float:
    """Largest torque difference between a URDF, loaded by Pinocchio, and the robot, divided by the largest torque.

    A URDF has no loops, so the torques of all joints of the tree are compared, as if each joint had a drive.

    Args:
        text: Text of the URDF.
        robot: The robot in memory; rotor inertias are taken from the robot, as a URDF has none.
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
    """The robot with its links, joints and friction replaced by those in a URDF.

    Args:
        text: Text of the URDF.
        robot: The robot, which supplies what a URDF lacks: rotor inertias, gravity, loops and drives.
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
    """Loads the text of a written URDF.

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
    """A ``robot.yaml`` without its entries on joints that the URDF does not have.

    For example, a URDF made from an MJCF lacks the joints that the ``robot.yaml`` locks.
    """
    content = {} if config is None else load_mapping(config, RobotError)
    in_urdf = {joint.get("name") for joint in ElementTree.fromstring(text.encode()).findall("joint")}
    lock, joints = content.get("lock") or [], content.get("joints") or {}
    if is_ros2_control(content) or (in_urdf.issuperset(lock) and in_urdf.issuperset(joints)):
        yield config
        return
    joints_in_urdf = {name: keys for name, keys in joints.items() if name in in_urdf}
    reduced = {**content, "lock": [name for name in lock if name in in_urdf], "joints": joints_in_urdf}
    with unnamed_file(settings_text(reduced).encode(), suffix=".yaml") as path:
        yield path


def mujoco_difference(text: str, robot: Robot, motion: Motion) -> float:
    """Largest torque difference between an MJCF, loaded by MuJoCo, and the robot, divided by the largest torque.

    The result is NaN if MuJoCo is not installed.

    Args:
        text: Text of the MJCF.
        robot: The robot in memory.
        motion: N samples of the active joints.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    if mujoco_problem(text) is not None:
        return float("nan")
    tree = tree_motion(robot, motion)
    return relative_difference(torque_of_mujoco(load_mujoco(text), robot, tree, {}), tree_torque(robot, tree))


def torque_of_mujoco(model: Any, robot: Robot, tree: TreeMotion, fixed_q: Mapping[str, float]) -> Float[Array, "N nt"]:
    """Torque [N m or N] that a motion needs in a loaded MuJoCo model, for every joint of the tree.

    Torques that the drives of the model exert at zero command are subtracted.

    Args:
        model: MuJoCo's model; its constraints are switched off by this function.
        robot: The robot, whose joints define the columns.
        tree: N samples of the motion of all joints.
        fixed_q: Positions [rad or m] of joints that only MuJoCo's model has, by name; zero for joints without an entry.
    """
    import mujoco

    # MuJoCo treats loops and dry friction as constraints. Without constraints the result is the torque of the tree
    # without dry friction, which is added at the end.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    places, order = mujoco_joints(model, robot)
    out = np.empty_like(tree.v)
    for k, (q, v, a) in enumerate(zip(tree.q, tree.v, tree.a, strict=True)):
        # Zeros keep a floating base upright and at rest.
        for values, own, at in ((data.qpos, q, places), (data.qvel, v, order), (data.qacc, a, order)):
            values[:] = 0.0
            values[at] = own
        for name, position in fixed_q.items():
            data.qpos[model.joint(name).qposadr[0]] = position
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse[order]
        data.ctrl[:] = 0.0
        mujoco.mj_fwdActuation(model, data)
        out[k] -= data.qfrc_actuator[order]
    return out + model.dof_frictionloss[order] * np.sign(tree.v)


def load_mujoco(text: str) -> Any:
    """Loads the text of an MJCF with MuJoCo.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    import mujoco

    try:
        return mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise RobotError(f"MuJoCo refuses the MJCF that was written ({' '.join(str(error).split())}).") from error


def mujoco_joints(model: Any, robot: Robot) -> tuple[list[int], list[int]]:
    """Indices of each joint of the robot's tree in MuJoCo's ``qpos`` and in ``qvel``."""
    import mujoco

    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(model.njnt)]
    joints = [names.index(name) for name in list(robot.model.names)[1:]]
    return model.jnt_qposadr[joints].tolist(), model.jnt_dofadr[joints].tolist()


def some_motion(motion: Motion, most: int = 200) -> Motion:
    """At most ``most`` samples of a motion, evenly spread."""
    return motion.at(np.unique(np.linspace(0, len(motion.t) - 1, most).astype(int)))


def versions() -> dict[str, str]:
    """Name and version of the library that loads each file format again; no entry for MJCF without MuJoCo."""
    out = {"urdf": f"Pinocchio {pin.__version__}"}
    if mujoco_problem() is None:
        import mujoco

        out["mjcf"] = f"MuJoCo {mujoco.__version__}"
    return out


def relative_difference(found: Float[Array, "N nt"], wanted: Float[Array, "N nt"]) -> float:
    """Largest difference of torques, divided by the largest expected torque."""
    largest = float(np.abs(wanted).max())
    return float(np.abs(found - wanted).max() / (largest if largest > 0 else 1.0))
