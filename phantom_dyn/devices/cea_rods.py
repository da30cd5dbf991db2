r"""The rods of the double parallelogram of the CEA branch: one parameter of each shows in the torque of the motors.

The source leaves them out of its model (section V.D) and states what they would add. A second rod runs beside the arm
from a point E of the shoulder to a piece CDG at the elbow, a third one beside the forearm from that piece to the
support of the handle; the piece keeps the direction of the shoulder, as the support does. "If the arm and the second
rod have the same translational velocity" all of the rod regroups with the arm, "else MYR2 can be identified": one
parameter per rod.

**It holds, and this is when.** The offset of E and E' is along X1, says the source. Then the rod's foot moves with q1,
and its first moment across the rod, MY, has a column of its own; its first moment along it, MX, regroups with that of
the arm and of the piece. Without rods the branch has 21 inertial base parameters (axis 1 horizontal), with the piece
22, the radial first moment of the piece; each rod adds one. With an offset along any other axis, or none, it adds none.
Counted on the regressor of the closed chain; lengths and masses are inputs, as the source gives none.

References:
    Section V.D of [CEA]_ (`phantom_dyn.devices.cea`).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from phantom_dyn.devices.cea import GRAVITY, LENGTHS
from phantom_dyn.devices.urdf_elements import Vector, add_joint, add_link, branch_elements, urdf_text
from phantom_dyn.errors import ParameterError

_HERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Rods:
    """Rods beside arm and forearm; none of it is published.

    Attributes:
        arm_offset: From the axes of arm and shoulder to the foot of the second rod, in the axes of the shoulder [m];
            None leaves the rod out.
        forearm_offset: From the elbow to the foot of the third rod, in the axes of the piece CDG [m]; None leaves the
            rod out.
        rod_mass: Of either rod [kg].
        piece_mass: Of the piece CDG [kg].

    Raises:
        ParameterError: If a mass is not above 0, or an offset is not three finite numbers.
    """

    arm_offset: Vector | None = (0.05, 0.0, 0.0)
    forearm_offset: Vector | None = (0.05, 0.0, 0.0)
    rod_mass: float = 0.02
    piece_mass: float = 0.05

    def __post_init__(self) -> None:
        for name in ("rod_mass", "piece_mass"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ParameterError(f"The {name} of the rods is {value} kg: give a number above 0.")
        for offset in (self.arm_offset, self.forearm_offset):
            if offset is not None and not (len(offset) == 3 and np.isfinite(offset).all()):
                raise ParameterError(f"The foot of a rod is at {offset}: give three lengths in metres, or None.")


def branch_with_rods_urdf(rods: Rods) -> str:
    """Text of the URDF of the built-in branch with the piece CDG (``piece``) and its rods (``rod2``, ``rod3``).

    Raises:
        RobotError: If the built-in branch is not installed.
    """
    out = ET.Element("robot", name="cea_branch_with_rods")
    out.extend(branch_elements())
    small = rods.piece_mass * 0.02**2
    add_link(out, "piece", rods.piece_mass, _HERE, (small, small, small))
    # The piece's axes are those of the shoulder, turned as those of the arm at q2 = 0.
    add_joint(out, "r_piece", ("link2", "piece"), (LENGTHS.d3, 0.0, 0.0), axis=(0.0, 0.0, 1.0))
    for name, parent, offset, length, turn in (
        ("rod2", "link1", rods.arm_offset, LENGTHS.d3, (-0.5 * math.pi, 0.0, 0.0)),
        ("rod3", "piece", rods.forearm_offset, LENGTHS.d4, _HERE),
    ):
        if offset is not None:
            across = rods.rod_mass * length**2 / 12
            add_link(out, name, rods.rod_mass, (0.5 * length, 0.0, 0.0), (1e-3 * across, across, across))
            add_joint(out, f"r_{name}", (parent, name), offset, axis=(0.0, 0.0, 1.0), turn=turn)
    return urdf_text(out)


def branch_with_rods_yaml(rods: Rods) -> str:
    """Text of the ``robot.yaml`` beside it: (8), (9), (11), and rods that stay parallel to arm and forearm."""
    passive = {"q3": "q5 - q2", "q4": "pi/2 - q5", "q6": "q2 - q5", "r_piece": "-q2"}
    passive |= {"r_rod2": "q2"} if rods.arm_offset is not None else {}
    passive |= {"r_rod3": "q5"} if rods.forearm_offset is not None else {}
    given = ", ".join(f'{name}: "{says}"' for name, says in passive.items())
    gravity = ", ".join(f"{g:g}" for g in GRAVITY)
    return f"gravity: [{gravity}]\nloops:\n  - {{kind: linear, active: [q2, q5], passive: {{{given}}}}}\n"
