# pyright: reportAttributeAccessIssue=false
"""The true machine: a table of links with whatever is wrong with it, compiled for MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from benchmarks.blind.generator.robots import GRAVITY, Link, Table

INNER_STEP = 2.5e-4


@dataclass(frozen=True)
class JointFriction:
    """Friction of one joint that the model lacks; the torque opposes motion.

    ``v > 0``: -(positive + c_positive v), ``v < 0``: negative - c_negative v, plus a part
    -extra exp(-(v/speed)^2) sign(v) that fades with speed.
    """

    positive: float = 0.0
    negative: float = 0.0
    c_positive: float = 0.0
    c_negative: float = 0.0
    extra: float = 0.0
    speed: float = 1.0


@dataclass(frozen=True)
class Plant:
    """What moves: the links, and per joint what the links do not say.

    Attributes:
        table: True links, payload included.
        friction: What the model lacks, one per joint.
        ratio: True torque over logged torque, one per joint.
        offset: Constant torque on the joint [N m].
        stiffness: Spring [N m/rad].
        rest: Rest position of the spring [rad].
    """

    table: Table
    friction: tuple[JointFriction, ...]
    ratio: tuple[float, ...]
    offset: tuple[float, ...]
    stiffness: tuple[float, ...]
    rest: tuple[float, ...]


def bare_plant(table: Table) -> Plant:
    """A machine with nothing beyond its links."""
    n = len(table.links)
    zero = (0.0,) * n
    return Plant(table, (JointFriction(),) * n, (1.0,) * n, zero, zero, zero)


def with_point_mass(link: Link, mass: float, center: np.ndarray) -> Link:
    """The link with a point mass fixed at ``center`` of its joint frame (parallel axes, about the common centre)."""
    total = link.mass + mass
    old, common = (
        np.asarray(link.center),
        (link.mass * np.asarray(link.center) + mass * np.asarray(center)) / (link.mass + mass),
    )
    xx, yy, zz, xy, xz, yz = link.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    for m, place in ((link.mass, old), (mass, np.asarray(center))):
        r = place - common
        inertia = inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
    flat = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    return replace(link, mass=total, center=tuple(map(float, common)), inertia=tuple(map(float, flat)))


def _numbers(values) -> str:
    return " ".join(f"{float(x):.12g}" for x in values)


def mjcf_text(plant: Plant, *, rigid: bool) -> str:
    """The machine as MJCF; ``rigid`` leaves out friction and springs (for inverse dynamics of the links alone)."""
    # Impedance next to one and a time constant of two steps: sliding friction is the exact torque, sticking holds.
    stick = f'solreffriction="{2.0 * INNER_STEP:.6g} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    body, tail = [], []
    for i, link in enumerate(plant.table.links):
        extra = plant.friction[i]
        law = (
            ""
            if rigid
            else (
                f'damping="{link.viscous + extra.c_positive:.12g}" '
                f'frictionloss="{link.coulomb + 0.5 * (extra.positive + extra.negative):.12g}" '
                f'stiffness="{plant.stiffness[i]:.12g}" springref="{plant.rest[i]:.12g}" {stick}'
            )
        )
        body += [
            f'<body pos="{_numbers(link.origin)}">',
            f'<inertial pos="{_numbers(link.center)}" mass="{link.mass:.12g}" fullinertia="{_numbers(link.inertia)}"/>',
            f'<joint name="{link.joint}" axis="{_numbers(link.axis)}" armature="{link.rotor_inertia:.12g}" {law}/>',
        ]
        tail.append("</body>")
    return "\n".join(
        [
            '<mujoco><compiler angle="radian" inertiafromgeom="false"/>',
            f'<option gravity="0 0 -{GRAVITY}" timestep="{INNER_STEP}" integrator="RK4"',
            'iterations="30" tolerance="1e-12">',
            '<flag contact="disable"/></option><worldbody>',
            *body,
            *tail,
            "</worldbody></mujoco>",
        ]
    )


def compiled(plant: Plant, *, rigid: bool = False) -> mujoco.MjModel:
    """The MuJoCo model of the machine."""
    return mujoco.MjModel.from_xml_string(mjcf_text(plant, rigid=rigid))


def rigid_torque(table: Table, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Torque that the links and rotors need along a motion, shape ``(N, nv)`` [N m]; no friction, no effect."""
    model = compiled(bare_plant(table), rigid=True)
    data = mujoco.MjData(model)
    out = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out


def mass_matrix(table: Table, q: np.ndarray) -> np.ndarray:
    """Mean mass matrix over configurations, rotors included, shape ``(nv, nv)``."""
    model = compiled(bare_plant(table), rigid=True)
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    total = np.zeros_like(full)
    for row in q:
        # Column by column through inverse dynamics: independent of how a MuJoCo version stores its sparse matrix.
        data.qpos[:] = row
        data.qvel[:] = 0.0
        data.qacc[:] = 0.0
        mujoco.mj_inverse(model, data)
        rest = data.qfrc_inverse.copy()
        for j in range(model.nv):
            data.qacc[:] = 0.0
            data.qacc[j] = 1.0
            mujoco.mj_inverse(model, data)
            total[:, j] += data.qfrc_inverse - rest
    return total / len(q)
