"""Sections 2 and 3, 5.1 and the appendix of the paper on the PHANToM: kinematics, dynamics, inertial parameters."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from papers.page import LOST, NOT_GIVEN, Row, Section, compared, exact
from phantom_dyn import load_robot
from phantom_dyn.devices.phantom import (
    PHANTOM_1_5,
    body_jacobian,
    coriolis_matrix,
    gravity_torque,
    inverse_kinematics,
    manipulability,
    mass_matrix,
    tip_position,
    tip_rotation,
    wrench_torque,
)
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion

MODULE = "`phantom_dyn.devices.phantom`"
STATES = 300
ALUMINIUM = 2700.0  # kg/m3


def postures(count: int = STATES) -> np.ndarray:
    """Joint angles [rad] in the assembly that the device can have."""
    q = np.random.default_rng(1).uniform(-1.2, 1.2, (10 * count, 3))
    reach = PHANTOM_1_5.l1 * np.cos(q[:, 1]) + PHANTOM_1_5.l2 * np.sin(q[:, 2])
    return q[(np.abs(q[:, 2] - q[:, 1]) < 1.5) & (reach > 1e-3)][:count]


def by_exponentials(q: np.ndarray) -> np.ndarray:
    """Tip [m] at joint angles ``(3,)`` by the product of exponentials of section 2.1."""
    l1, l2 = PHANTOM_1_5.l1, PHANTOM_1_5.l2

    def turned(axis: np.ndarray, point: list[float], angle: float) -> np.ndarray:
        twist = np.zeros((4, 4))
        twist[:3, :3], twist[:3, 3] = np.cross(axis, np.eye(3)).T, -np.cross(axis, point)
        return expm(twist * angle)

    x, y, _ = np.eye(3)
    base = turned(y, [0.0, 0.0, -l1], q[0])
    elbow = base @ turned(-x, [0.0, l2, -l1], q[1]) @ [0.0, l2, 0.0, 1.0]
    return elbow[:3] + base[:3, :3] @ turned(-x, [0.0, 0.0, 0.0], q[2])[:3, :3] @ [0.0, -l2, 0.0]


def kinematics() -> Section:
    q = postures()
    tip = np.array([by_exponentials(angles) for angles in q])
    step = 1e-6
    slope = np.stack([(tip_position(q + step * e) - tip_position(q - step * e)) / (2 * step) for e in np.eye(3)], -1)
    J = body_jacobian(q)[:, :3]
    force = np.random.default_rng(2).normal(size=(len(q), 3))
    power = np.einsum("nij,ni->nj", slope, force)
    given = wrench_torque(q, np.concatenate([force, np.zeros_like(force)], axis=1))
    angles = np.deg2rad(np.arange(-45.0, 135.0, 0.1))
    level = manipulability(np.stack([0 * angles, angles, angles], axis=1))
    flat = np.rad2deg(angles[level > level.max() - 1e-9])
    low, high = flat[flat < 45], flat[flat > 45]
    return Section(
        "2 Kinematics",
        f"{MODULE}; Figure 3: `examples/phantom_maps.py`",
        (
            Row(
                "(1) forward kinematics",
                "closed form",
                "the same",
                exact(float(np.abs(tip - tip_position(q)).max()), "m"),
                f"beside the product of exponentials of 2.1, {len(q)} postures",
            ),
            Row(
                "2.2 inverse kinematics",
                "closed form",
                "the same",
                exact(float(np.abs(inverse_kinematics(tip_position(q)) - q).max()), "rad"),
                "round trip; valid for abs(theta3 - theta2) < 90 degrees, beyond that it gives the other assembly",
            ),
            Row(
                "2.3 body Jacobian",
                "closed form",
                "the same",
                "none beyond finite differences" if np.abs(tip_rotation(q) @ J - slope).max() < 1e-8 else "differs",
                "R is that of (1): the text names an equation seven that is not there",
            ),
            Row(
                "2.3 torque against a wrench",
                "J^T F",
                "the same",
                "none beyond finite differences" if np.abs(given - power).max() < 1e-8 else "differs",
                "by virtual power",
            ),
            Row(
                "Figure 3, largest manipulability",
                "no number",
                f"{level.max():.6f} = l2 / l1",
                "",
                f"on theta2 = theta3 from {low.min():.1f} to {abs(low.max()):.0f} degrees and from {high.min():.1f} to "
                f"{high.max():.0f} degrees: no single best point",
            ),
            Row("Figure 3, limits of the joints", NOT_GIVEN, "none assumed", "", "the map ends where the reach ends"),
        ),
    )


def dynamics() -> Section:
    rng = np.random.default_rng(3)
    q, v, a = postures(), 5 * rng.normal(size=(STATES, 3)), 50 * rng.normal(size=(STATES, 3))
    ours = np.einsum("nij,nj->ni", mass_matrix(q), a) + np.einsum("nij,nj->ni", coriolis_matrix(q, v), v)
    by_tree = inverse_dynamics(load_robot("phantom_1_5"), Motion(np.arange(float(STATES)), q, v, a))
    origin = np.diag(mass_matrix(np.zeros((1, 3)))[0])
    step = 1e-6
    M_dot = (mass_matrix(q + step * v) - mass_matrix(q - step * v)) / (2 * step)
    skew = M_dot - 2 * coriolis_matrix(q, v)
    is_skew = np.abs(skew + np.swapaxes(skew, 1, 2)).max() < 1e-9
    gravity = gravity_torque(np.array([[0.0, 0.0, np.pi / 2]]))[0]
    coupling = PHANTOM_1_5.l1 * (PHANTOM_1_5.l2 * PHANTOM_1_5.m_a + PHANTOM_1_5.l3 * PHANTOM_1_5.m_c)
    return Section(
        "3 Dynamics, and 5.1 their use",
        f"{MODULE}; as a robot: `load_robot('phantom_1_5')`",
        (
            Row(
                "M, C and N together",
                "closed form",
                "the same, with C32 below",
                exact(float(np.abs(ours + gravity_torque(q) - by_tree).max()), "N m"),
                f"beside Pinocchio's inverse dynamics of a tree with a parallelogram, {STATES} states",
            ),
            Row(
                "M at the origin",
                "no number",
                f"diag({', '.join(f'{1e3 * entry:.4f}' for entry in origin)}) g m2",
                "",
                "m_e and I_e in M are those of segment C, I_dfy and I_dfz are I_dfyy and I_dfzz",
            ),
            Row("C11", f"{LOST}: its second line", "rebuilt from the Lagrangian", "", "dM/dt - 2C is skew with it"),
            Row(
                "C32",
                "+1/2 P cos(theta2 - theta3) dtheta2/dt",
                "-1/2 P cos(theta2 - theta3) dtheta2/dt",
                f"{1e3 * coupling:.4f} mN m at 1 rad/s",
                f"misprint: with ours dM/dt - 2C {'is' if is_skew else 'is not'} skew, as the Lagrangian has it; the "
                "difference is that of the torque of joint 3 at theta2 = theta3",
            ),
            Row(
                "N2, N3 at their largest",
                "no number",
                f"{1e3 * gravity[1]:.2f} cos(theta2), {1e3 * gravity[2]:.2f} sin(theta3) mN m",
                "",
                "the motors are more than a counterweight",
            ),
            Row(
                "5.1 gravity compensation",
                '"works very well"',
                "nothing is left",
                "",
                "N is exact by the first row; what is left on a device is what its parameters are off by",
            ),
        ),
    )


def appendix() -> Section:
    p = PHANTOM_1_5
    be, df = p.inertia_be, p.inertia_df
    sides = {"BE": be[1] + be[2] - be[0], "DF": df[1] + df[2] - df[0]}
    links = {"BE": p.link_inertia_be, "DF": p.link_inertia_df}
    rods = ((p.m_a, p.l2, p.inertia_a[0], "segment A"), (p.m_c, p.l1, p.inertia_c[0], "segment C"))
    return Section(
        "Appendix: inertial parameters",
        f"`PHANTOM_1_5` of {MODULE}",
        (
            Row("lengths, masses, moments, Figure 7", "printed", "used as printed", "", "but for what follows"),
            *(
                compared(
                    f"{name}, m l^2 / 12 of a thin rod",
                    f"{1e4 * printed:.4f}".rstrip("0"),
                    1e4 * mass * length**2 / 12,
                    "1e-4 kg m2",
                    reason="its moment is about its centre, half-way along",
                )
                for mass, length, printed, name in rods
            ),
            *(
                Row(
                    f"segment {name}, I_yy + I_zz - I_xx",
                    f"{1e4 * printed:.3f} 1e-4 kg m2",
                    f"{1e4 * (link[1] + link[2] - link[0]):.3f} 1e-4 kg m2",
                    "",
                    "no body has the printed moments: they hold the geared rotor; without it, 1.08e-6 kg m2 times "
                    "11.6^2 (assumed, a Maxon RE25), and about its centre, it is a body",
                )
                for (name, printed), link in zip(sides.items(), links.values(), strict=True)
            ),
            Row(
                "moments of BE and DF are about",
                NOT_GIVEN,
                "the joint's centre",
                "",
                "only so they give the printed M, which has no m_be l5^2 and no m_df l6^2",
            ),
            Row("I_begg", "0.591e-4 kg m2", "I_bezz", "", "misprint"),
            Row("segments D and E", 'both "actuating axis 2"', "D drives axis 3", "", "misprint"),
            compared("density of aluminium", "1750", ALUMINIUM, "kg/m3", digits=0, reason="misprint, or no aluminium"),
        ),
    )
