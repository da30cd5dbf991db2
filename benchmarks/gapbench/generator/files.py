"""The two robot files that a diagnosis is given: URDF and robot.yaml."""

from __future__ import annotations

from .recipes import payload_link
from .robots import Table, Tolerance


def _triple(values: tuple[float, ...]) -> str:
    return " ".join(f"{x:.9g}" for x in values)


def urdf_text(table: Table) -> str:
    """The robot as URDF (of a closed chain its tree), modelled friction in ``<dynamics>``."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{table.name}">', '  <link name="base"/>']
    for number, link in enumerate(table.links, start=1):
        parent = f"link{link.parent + 1}" if link.parent >= 0 else "base"
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.inertia, strict=True)
        lines += [
            f'  <link name="link{number}">',
            "    <inertial>",
            f'      <origin xyz="{_triple(link.center)}" rpy="0 0 0"/>',
            f'      <mass value="{link.mass:.9g}"/>',
            "      <inertia " + " ".join(f'{name}="{x:.9g}"' for name, x in moments) + "/>",
            "    </inertial>",
            "  </link>",
            f'  <joint name="{link.joint}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="link{number}"/>',
            f'    <origin xyz="{_triple(link.origin)}" rpy="{_triple(link.rotation)}"/>',
            f'    <axis xyz="{_triple(link.axis)}"/>',
            '    <limit lower="-3.9" upper="3.9" effort="1000" velocity="30"/>',
            f'    <dynamics damping="{link.viscous:.9g}" friction="{link.coulomb:.9g}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def _followed(follows: tuple[tuple[str, float], ...]) -> str:
    """Coefficients as the contract writes them: ``theta3 - theta2``."""
    terms = sorted(follows, key=lambda one: one[1] < 0)
    first, *rest = (("-" if c < 0 else "+", name) for name, c in terms)
    return " ".join([first[1] if first[0] == "+" else f"-{first[1]}", *(f"{sign} {name}" for sign, name in rest)])


def robot_yaml(table: Table, *, torque_hold: str, encoder_counts: int, tolerance: Tolerance) -> str:
    """What the owner states beside the URDF."""
    lines = [
        f"gravity: [{', '.join(f'{x:g}' for x in table.gravity)}]",
        f"torque_hold: {torque_hold}",
        "torque_source: command",
        f"tolerance: {{inertia: {tolerance.inertia}, friction: {tolerance.friction}, "
        f"rotor_inertia: {tolerance.rotor_inertia}}}",
        "joints:",
    ]
    for link in table.driven:
        lines.append(f"  {link.joint}: {{rotor_inertia: {link.rotor_inertia:.9g}, encoder_counts: {encoder_counts}}}")
    if table.passive:
        passive = ", ".join(f'{name}: "{_followed(follows)}"' for name, follows in table.passive)
        lines += ["loops:", f"  - {{kind: linear, active: [{', '.join(table.joints)}], passive: {{{passive}}}}}"]
        lines += [f"payload_frame: link{payload_link(table) + 1}"]
    return "\n".join([*lines, ""])
