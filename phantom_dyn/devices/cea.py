r"""Upper branch of the CEA LIST haptic interface: published numbers, frames, kinematics and loop in closed form.

The branch has a shoulder (q1), an arm (q2) and a forearm that a parallelogram drives (q5); a second parallelogram keeps
the support of the handle parallel to the shoulder. The frames are those of a modified Denavit-Hartenberg table
(Khalil): the origin of frame 0 is the intersection of the axes of q1 and q2, z0 is along the axis of q1, and the pose
of frame j in frame a(j) is :math:`T_j = Rot_x(\alpha_j)\,Trans_x(d_j)\,Rot_z(\theta_j)`, as all r, gamma and b are
zero. The tip is the origin of frame 4. The loop is cut at joint 7: frame 7, fixed to link 6, and frame 8, fixed to
link 3, have to coincide.

Errors and omissions of the source; a test covers each point:

- Table 1 prints :math:`d_8 = -d_6`, with which the loop stays open by :math:`2 d_6`. It closes with :math:`+d_6`.
- The link lengths d3, d4, d6 are not given: see `LinkLengths`.
- The direction of gravity in frame 0 is not given: see `GRAVITY`.
- Table 2 and the electric stiffness are printed in N m/rad, which is impossible: see `STIFFNESS_UNITS`.
- The source says that all parameters of link 4 regroup with link 1. The radial first moment MY4 does not regroup; it is
  missing in the list of section V.D.
- The last row of Table 3 is printed ``FV5t3`` and is ``FC5t3``; axes "2 and 3" of the text are 2 and 5.

References:
    .. [CEA] A. Janot, C. Bidard, F. Gosselin, M. Gautier et al., Modeling and Identification of a 3 DOF Haptic
       Interface, IEEE International Conference on Robotics and Automation, 2007. Equation and table numbers are those
       of the paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_positive

JOINTS = ("q1", "q2", "q5")
"""Active joints; q3, q4 and q6 are passive, and the loop is cut at q7."""

GRAVITY = (0.0, -9.81, 0.0)
"""Default gravity in frame 0 [m/s^2], which the source does not give. The axis of q1 cannot be vertical, because the
source identifies the first moment MY1R. With this default the arm is level at q1 = 0."""


@dataclass(frozen=True)
class LinkLengths:
    """Lengths of arm, forearm and parallelogram lever [m]. The source does not give them, so that they are inputs.

    With the default, one posture has the published apparent mass, Coulomb force and stiffness (see
    `phantom_dyn.devices.cea_dynamics.nearest_posture`). Arms of 0.35 to 0.59 m have such a posture too, but from 0.57 m
    on no rigid links have the parameters of Table 4. `d6` is in no equation with the parameters of Table 4.
    """

    d3: float = 0.400
    d4: float = 0.311
    d6: float = 0.080

    def __post_init__(self):
        require_positive(**{f"link length {name}": length for name, length in vars(self).items()})


LENGTHS = LinkLengths()
"""Default lengths, which are those of the built-in robot."""


@dataclass(frozen=True)
class Published:
    """A published number: value, relative standard deviation [%] and unit."""

    value: float
    deviation: float
    unit: str

    @property
    def std(self) -> float:
        """Standard deviation in the unit of the value, from the relative standard deviation (7)."""
        return abs(self.value) * self.deviation / 100


def _table(unit_of: Mapping[str, str], rows: Mapping[str, tuple[float, float]]) -> Mapping[str, Published]:
    def unit(name: str) -> str:
        return next(unit for start, unit in unit_of.items() if name.startswith(start))

    return MappingProxyType({name: Published(*row, unit(name)) for name, row in rows.items()})


_FRICTION_UNITS = {"FV": "N m s/rad", "FS": "N m", "FC": "N m", "OFF": "N m"}

TRANSMISSION_STIFFNESS = _table(
    {"K": "N m/rad"},  # as printed; see STIFFNESS_UNITS
    {"K1": (2.0, 0.4), "K2": (2.0, 0.3), "K5": (2.0, 0.5)},
)
"""Table 2, with the unit that is printed there."""

ELECTRIC_STIFFNESS = 2.0
"""K_E of (19), in the unit of Table 2."""

FRICTION_TESTS = _table(
    _FRICTION_UNITS,
    {
        "FV1": (0.020, 15.0),
        "FS1": (0.130, 0.9),
        "FV2t1": (0.021, 10.0),
        "FC2t1": (0.120, 0.8),
        "FV2t2": (0.022, 9.0),
        "FC2t2": (0.120, 0.7),
        "FV5t1": (0.018, 20.0),
        "FC5t1": (0.120, 0.9),
        "FV5t3": (0.020, 15.0),
        "FC5t3": (0.120, 0.9),
    },
)
"""Table 3: friction of the active joints from the tests t1, t2 and t3."""

INERTIAL = _table(
    {"MX": "kg m", "MY": "kg m", "XX": "kg m^2", "ZZ": "kg m^2", **_FRICTION_UNITS},
    {
        "ZZ1R": (0.0510, 0.448),
        "MY1R": (-0.0260, 1.2),
        "FV1": (0.023, 22.0),
        "FS1": (0.1179, 0.7823),
        "XX2R": (-0.0209, 0.8488),
        "ZZ2R": (0.0295, 0.3538),
        "MX2R": (-0.0225, 0.7660),
        "FV2R": (0.032, 21.0),
        "FS2": (0.1240, 0.8120),
        "OFF2": (0.0200, 3.347),
        "XX3R": (-0.0110, 1.25),
        "ZZ3R": (0.0130, 0.432),
        "MX3R": (-0.0310, 0.413),
        "FV5R": (0.031, 20.0),
        "FS5R": (0.1152, 1.258),
        "OFF5": (0.0300, 1.1),
    },
)
"""Table 4: the 16 parameters of the inverse dynamic model. Its viscous coefficients are 15 to 60 % above Table 3."""

STIFFNESS_UNITS = MappingProxyType({"N m/rad": 1.0, "N m/deg": 180.0 / np.pi, "N m/mrad": 1000.0})
"""Units that the numbers of Table 2 may have, each in N m/rad.

In N m/rad, as printed, joint 5 would resonate at 2 Hz (the source says about 20 Hz), and 2000 to 5000 N/m at the tip
would need levers of 14 to 22 mm. Only N m/mrad agrees with both statements within a factor of about two."""

COULOMB_FRICTION = (INERTIAL["FS1"].value, INERTIAL["FS2"].value, INERTIAL["FS5R"].value)
"""Coulomb torques of the active joints, from Table 4 [N m]; F_c of (18)."""

MASS_RANGE_KG = (0.0, 0.65)
"""Published apparent mass near the natural posture; up to 0.8 kg elsewhere."""
STIFFNESS_RANGE = (2000.0, 5000.0)
"""Published stiffness at the tip [N/m]."""
COULOMB_RANGE_N = (0.3, 0.4)
"""Published Coulomb force at the tip [N], the weight of 30 to 40 g."""


def joint_stiffness(unit: str = "N m/mrad") -> Float[Array, " 3"]:
    r"""Stiffness of transmission and motor in series [N m/rad], (19): :math:`K_{tot} = 1/(1/K_T + 1/K_E)`.

    Args:
        unit: Unit of the numbers in the source, one of `STIFFNESS_UNITS`.

    Returns:
        One per active joint, shape ``(3,)``.

    Raises:
        ParameterError: If the unit is none of these.
    """
    if unit not in STIFFNESS_UNITS:
        known = ", ".join(STIFFNESS_UNITS)
        raise ParameterError(f"{unit!r} is no unit of the stiffness of the CEA branch: take one of {known}.")
    transmission = np.array([K.value for K in TRANSMISSION_STIFFNESS.values()])
    return STIFFNESS_UNITS[unit] / (1 / transmission + 1 / ELECTRIC_STIFFNESS)


def resonance_hz(stiffness: float, inertia: float) -> float:
    r"""Resonance :math:`\sqrt{K/I}/2\pi` [Hz] of an inertia [kg m^2] on a stiffness [N m/rad]."""
    return float(np.sqrt(stiffness / inertia) / (2 * np.pi))


def passive_positions(q: Float[Array, "N 3"]) -> Float[Array, "N 4"]:
    """Angles q3, q4, q6 of the passive joints and q7 of the cut joint [rad], by (8), (11), (9), (10).

    Args:
        q: Active angles q1, q2, q5 [rad].
    """
    q2, q5 = q[:, 1], q[:, 2]
    return np.stack([q5 - q2, 0.5 * np.pi - q5, q2 - q5, q5 - q2], axis=1)


def passive_jacobian() -> Float[Array, "3 3"]:
    r"""L of (12), :math:`\partial q_p / \partial q_a` with rows q3, q6, q4 (the order of the source)."""
    return np.array([[0.0, -1.0, 1.0], [0.0, 1.0, -1.0], [0.0, 0.0, -1.0]])


def tip_position(q: Float[Array, "N 3"], lengths: LinkLengths = LENGTHS) -> Float[Array, "N 3"]:
    """Position of the tip in frame 0 [m].

    Args:
        q: Active angles q1, q2, q5 [rad].
        lengths: Lengths of the links.
    """
    q1, q2, q5 = q.T
    reach = lengths.d3 * np.cos(q2) + lengths.d4 * np.cos(q5)
    height = -(lengths.d3 * np.sin(q2) + lengths.d4 * np.sin(q5))
    return np.stack([reach * np.cos(q1), reach * np.sin(q1), height], axis=1)


def tip_jacobian(q: Float[Array, "N 3"], lengths: LinkLengths = LENGTHS) -> Float[Array, "N 3 3"]:
    """Derivative of `tip_position` by the active angles, axes of frame 0 [m/rad].

    Args:
        q: Active angles q1, q2, q5 [rad].
        lengths: Lengths of the links.
    """
    q1, q2, q5 = q.T
    c1, s1, nothing = np.cos(q1), np.sin(q1), np.zeros(len(q))
    reach = lengths.d3 * np.cos(q2) + lengths.d4 * np.cos(q5)
    columns = [np.stack([-reach * s1, reach * c1, nothing], axis=1)]
    for length, angle in ((lengths.d3, q2), (lengths.d4, q5)):
        fall = -length * np.sin(angle)
        columns.append(np.stack([fall * c1, fall * s1, -length * np.cos(angle)], axis=1))
    return np.stack(columns, axis=2)


@dataclass(frozen=True)
class Row:
    """One row of Table 1: joint, preceding frame, twist [rad] and length [m].

    ``turns`` is False for frame 8, which is fixed to link 3 (sigma = 2 in the table).
    """

    joint: int
    before: int
    twist: float
    length: float
    turns: bool = True


def table_1(lengths: LinkLengths) -> tuple[Row, ...]:
    """Table 1 with :math:`d_8 = +d_6`, which closes the loop; the source prints :math:`-d_6`."""
    quarter = -0.5 * np.pi
    return (
        Row(1, 0, 0.0, 0.0),
        Row(2, 1, quarter, 0.0),
        Row(3, 2, 0.0, lengths.d3),
        Row(4, 3, 0.0, lengths.d4),
        Row(5, 1, quarter, 0.0),
        Row(6, 5, 0.0, lengths.d6),
        Row(7, 6, 0.0, lengths.d3),
        Row(8, 3, 0.0, lengths.d6, turns=False),
    )


def frames(q: Float[Array, " 3"], rows: tuple[Row, ...]) -> Float[Array, "n 4 4"]:
    """Poses of frames 0, 1, ... in frame 0; passive angles follow from (8) to (11).

    Args:
        q: Active angles q1, q2, q5 [rad].
        rows: Rows of the table, from its top.

    Returns:
        Homogeneous matrices: the identity, then one per row.
    """
    q3, q4, q6, q7 = passive_positions(q[None])[0]
    angle = dict(enumerate((q[0], q[1], q3, q4, q[2], q6, q7), start=1))
    poses = [np.eye(4)]
    for row in rows:
        poses.append(poses[row.before] @ _step(row.twist, row.length, angle[row.joint] if row.turns else 0.0))
    return np.stack(poses)


def closure_error(q: Float[Array, " 3"], rows: tuple[Row, ...]) -> tuple[float, float]:
    """Distance [m] of the origins of frames 7 and 8, and largest difference of their rotation matrices.

    Args:
        q: Active angles q1, q2, q5 [rad].
        rows: All eight rows of the table.
    """
    difference = frames(q, rows)[7] - frames(q, rows)[8]
    return float(np.linalg.norm(difference[:3, 3])), float(np.abs(difference[:3, :3]).max())


def _step(twist: float, length: float, angle: float) -> Array:
    ca, sa, c, s = np.cos(twist), np.sin(twist), np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, length], [ca * s, ca * c, -sa, 0], [sa * s, sa * c, ca, 0], [0, 0, 0, 1]])
