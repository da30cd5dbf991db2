"""Robot files and configurations as people write them."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from .robots import Robot

FINGER = ("panda_finger_joint1", "panda_finger_joint2")
FINGER_MASS, FINGER_INERTIA = 0.015, 2.0e-6
FINGERS_AT = (0.0, 0.0, 0.16)  # in the last joint's frame [m]


def _numbers(values: object) -> str:
    return " ".join(f"{float(x):.9g}" for x in np.ravel(values))  # type: ignore[arg-type]  # anything array-like


def _inertial(mass: float, center: object, inertia: np.ndarray) -> str:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    moments = (("ixx", xx), ("ixy", xy), ("ixz", xz), ("iyy", yy), ("iyz", yz), ("izz", zz))
    said = " ".join(f'{name}="{value:.9g}"' for name, value in moments)
    return (
        f'<inertial><origin xyz="{_numbers(center)}" rpy="0 0 0"/><mass value="{mass:.9g}"/>'
        f"<inertia {said}/></inertial>"
    )


def _limits(robot: Robot, i: int) -> tuple[float, float]:
    joint = robot.kind.joints[i]
    return joint.home - 1.6 * joint.swing - 0.05, joint.home + 1.6 * joint.swing + 0.05


def _finger_centers() -> list[np.ndarray]:
    return [np.array(FINGERS_AT) + np.array([0.0, 0.01 * side, 0.02]) for side in (1.0, -1.0)]


def without_fingers(mass: float, center: np.ndarray, inertia: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """The last link of the file: what the chain's link is without the fingers that are fixed to it."""

    def about(weight: float, at: np.ndarray) -> np.ndarray:
        return weight * (at @ at * np.eye(3) - np.outer(at, at))

    moment = inertia + about(mass, center)
    first = mass * center
    for at in _finger_centers():
        moment = moment - FINGER_INERTIA * np.eye(3) - about(FINGER_MASS, at)
        first = first - FINGER_MASS * at
    left = mass - 2.0 * FINGER_MASS
    return left, first / left, moment - about(left, first / left)


def _fingers(link: str) -> list[str]:
    """Two fingers, each on a linear joint."""
    lines, tiny = [], np.eye(3) * FINGER_INERTIA
    for name, side in zip(FINGER, (1.0, -1.0), strict=True):
        part = name.replace("_joint", "")
        lines += [
            f'  <link name="{part}">{_inertial(FINGER_MASS, (0.0, 0.01 * side, 0.02), tiny)}</link>',
            f'  <joint name="{name}" type="prismatic"><parent link="{link}"/><child link="{part}"/>',
            f'    <origin xyz="{_numbers(FINGERS_AT)}" rpy="0 0 0"/><axis xyz="0 {side:g} 0"/>',
            '    <limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>',
        ]
    return lines


def urdf(robot: Robot) -> str:
    """The given robot as URDF: limits, inertias, and friction where a data sheet gives any."""
    chain = robot.given
    lines = [f'<?xml version="1.0"?>\n<robot name={quoteattr(robot.kind.name)}>', '  <link name="base_link"/>']
    before = "base_link"
    for i, joint in enumerate(robot.kind.joints):
        link = f"{joint.name.removesuffix('_joint')}_link"
        mass, center, inertia = chain.mass[i], chain.center[i], chain.inertia[i]
        if robot.kind.fingers and i == chain.n - 1:
            mass, center, inertia = without_fingers(mass, center, inertia)
        low, high = _limits(robot, i)
        lines += [
            f'  <link name="{link}">{_inertial(mass, center, inertia)}</link>',
            f'  <joint name="{joint.name}" type="{"prismatic" if joint.linear else "revolute"}">',
            f'    <parent link="{before}"/><child link="{link}"/>',
            f'    <origin xyz="{_numbers(joint.xyz)}" rpy="{_numbers(joint.rpy)}"/>',
            f'    <axis xyz="{_numbers(joint.axis)}"/>',
            f'    <limit lower="{low:.4g}" upper="{high:.4g}" effort="1000" velocity="{3 * joint.speed:.4g}"/>',
            f'    <dynamics damping="{robot.viscous[i]:.9g}" friction="{robot.coulomb[i]:.9g}"/>',
            "  </joint>",
        ]
        before = link
    if robot.kind.fingers:
        lines += _fingers(before)
    return "\n".join([*lines, "</robot>", ""])


def mjcf(robot: Robot) -> str:
    """The given robot as MJCF, whose joints also say their armature."""
    chain, lines, ends = robot.given, [], []
    for i, joint in enumerate(robot.kind.joints):
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = chain.inertia[i]
        low, high = _limits(robot, i)
        pad = "  " * (i + 2)
        lines += [
            f'{pad}<body name="{joint.name}_link" pos="{_numbers(joint.xyz)}" euler="{_numbers(joint.rpy)}">',
            f'{pad}  <inertial mass="{chain.mass[i]:.9g}" pos="{_numbers(chain.center[i])}" '
            f'fullinertia="{_numbers((xx, yy, zz, xy, xz, yz))}"/>',
            f'{pad}  <joint name="{joint.name}" type="{"slide" if joint.linear else "hinge"}" '
            f'axis="{_numbers(joint.axis)}" range="{low:.4g} {high:.4g}" damping="{robot.viscous[i]:.9g}" '
            f'frictionloss="{robot.coulomb[i]:.9g}" armature="{robot.rotor[i]:.9g}"/>',
        ]
        ends.insert(0, f"{pad}</body>")
    motors = [f'    <motor name="{j.name}" joint="{j.name}"/>' for j in robot.kind.joints]
    head = [
        f"<mujoco model={quoteattr(robot.kind.name)}>",
        '  <compiler angle="radian" eulerseq="XYZ" autolimits="true"/>',
        '  <option gravity="0 0 -9.81"/>',
        "  <worldbody>",
    ]
    return "\n".join(
        [*head, *lines, *ends, "  </worldbody>", "  <actuator>", *motors, "  </actuator>", "</mujoco>", ""]
    )


def config(robot: Robot, *, source: str, counts: bool, drives: dict[str, tuple[float, float]], rotors: bool) -> str:
    """A sparse ``robot.yaml``; empty where nothing is to be said.

    Args:
        robot: What it is about.
        source: ``torque_source``; ``command`` is what a reader takes anyway and is left out.
        counts: State the encoder steps of the turning joints.
        drives: Torque constant and gear ratio of each joint, where the log holds currents.
        rotors: State the rotor inertias.
    """
    lines = [] if source == "command" else [f"torque_source: {source}"]
    joints = []
    for i, joint in enumerate(robot.kind.joints):
        said = {}
        if rotors and robot.rotor[i]:
            said["rotor_inertia"] = f"{robot.rotor[i]:.6g}"
        if joint.name in drives:
            constant, gear = drives[joint.name]
            said |= {"torque_constant": f"{constant:.6g}", "gear_ratio": f"{gear:.6g}"}
        if counts and not joint.linear:
            said["encoder_counts"] = f"{robot.kind.counts:.0f}"
        if said:
            joints.append(f"  {joint.name}: {{{', '.join(f'{k}: {v}' for k, v in said.items())}}}")
    if joints:
        lines += ["joints:", *joints]
    if robot.kind.fingers:
        lines.append(f"lock: [{', '.join(FINGER)}]")
    return "\n".join([*lines, ""]) if lines else ""
