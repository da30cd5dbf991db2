"""The files of a case: the given model as URDF and YAML, and the recording as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .robots import Part, Robot, Tolerance


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{x:.9g}" for x in values)


def _inertial(part: Part) -> list[str]:
    xx, yy, zz = part.inertia
    return [
        "    <inertial>",
        f'      <origin xyz="{_numbers(part.center)}"/>',
        f'      <mass value="{part.mass:.9g}"/>',
        f'      <inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/>',
        "    </inertial>",
    ]


def urdf(robot: Robot, *, friction: bool = True) -> str:
    """The robot as URDF; without friction for Drake, which would add it to its own dynamics."""
    lines, parent = [f'<robot name="{robot.kind}">', '  <link name="base"/>'], "base"
    for part in robot.parts:
        lines += [f'  <link name="{part.joint}_part">', *_inertial(part), "  </link>"]
        limit = part.reach * 2.5
        lines += [
            f'  <joint name="{part.joint}" type="{"prismatic" if part.linear else "revolute"}">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{part.joint}_part"/>',
            f'    <origin xyz="{_numbers(part.place)}"/>',
            f'    <axis xyz="{_numbers(part.axis)}"/>',
            f'    <limit lower="{part.home - limit:.6g}" upper="{part.home + limit:.6g}" '
            f'effort="1000" velocity="{5.0 * part.speed:.6g}"/>',
        ]
        if friction:
            lines.append(f'    <dynamics damping="{part.wet:.9g}" friction="{part.dry:.9g}"/>')
        lines.append("  </joint>")
        parent = f"{part.joint}_part"
    return "\n".join([*lines, "</robot>", ""])


def yaml(robot: Robot, tolerance: Tolerance) -> str:
    """What a URDF cannot say; counts of hinges only, since they are counts of a turn."""
    lines = [
        f"gravity: [{', '.join(f'{x:g}' for x in robot.gravity)}]",
        "torque_hold: zoh",
        "torque_source: command",
        f"tolerance: {{inertia: {tolerance.inertia:g}, friction: {tolerance.friction:g}, "
        f"rotor_inertia: {tolerance.rotor_inertia:g}}}",
        "joints:",
    ]
    for part in robot.parts:
        counts = "" if part.linear else f", encoder_counts: {part.counts}"
        lines.append(f"  {part.joint}: {{rotor_inertia: {part.rotor:.9g}{counts}, encoder_side: motor}}")
    return "\n".join([*lines, ""])


def write_log(path: Path, joints: tuple[str, ...], log: np.ndarray) -> None:
    """Time, readings and commands as CSV.

    Args:
        log: Columns t, q of every joint, tau of every joint, shape ``(N, 1 + 2 n)``.
    """
    header = ",".join(["t", *(f"q.{j}" for j in joints), *(f"tau.{j}" for j in joints)])
    np.savetxt(path, log, fmt="%.10g", delimiter=",", header=header, comments="")
