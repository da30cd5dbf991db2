"""What a map needs to know of a robot: its tree, how active joints drive it, friction and stiffness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phantom_dyn.maps.tree import Tree, mass_and_weight, poses, tip_jacobian, tip_position

Array = np.ndarray


@dataclass(frozen=True)
class MapModel:
    """A robot reduced to arrays, which a process that computes blocks receives.

    ``nt`` joints of the tree, ``nv`` active ones.

    Attributes:
        name: Of the robot.
        frame: Of the tip.
        joint_names: Active joints.
        active: Their places in the tree.
        tree: Kinematics and inertias.
        linear_map: Tree positions are ``linear_map q + offset``, shape ``(nt, nv)``; used where ``solve`` is None.
        offset: [rad or m], shape ``(nt,)``.
        solve: Of a chain that is closed numerically: positions ``(N, nt)`` and slopes ``(N, nt, nv)`` of ``(N, nv)``
            active positions, rows of NaN where it cannot be closed.
        lower: Lowest position of each tree joint, ``-inf`` where nothing binds, shape ``(nt,)``.
        upper: Highest one.
        prismatic: True for a linear active joint, shape ``(nv,)``.
        viscous: Coefficients of the tree's joints [N m s/rad], shape ``(nt,)``.
        coulomb: Torques of the tree's joints [N m], shape ``(nt,)``.
        stiffness: Of the active joints [N m/rad], shape ``(nv,)``, or None.
        stiffness_note: Where the stiffness comes from, for captions.
        posture: Configuration that a branch is chosen by and that stands in for joints without a grid, ``(nv,)``.
        branches: Closed-form inverse kinematics: candidates ``(B, N, nv)`` of tip positions ``(N, 3)``, or None.
    """

    name: str
    frame: str
    joint_names: tuple[str, ...]
    active: tuple[int, ...]
    tree: Tree
    linear_map: Array
    offset: Array
    solve: Callable[[Array], tuple[Array, Array]] | None
    lower: Array
    upper: Array
    prismatic: Array
    viscous: Array
    coulomb: Array
    stiffness: Array | None
    stiffness_note: str
    posture: Array
    branches: Callable[[Array], Array] | None

    @property
    def nv(self) -> int:
        """Number of active joints."""
        return len(self.joint_names)


@dataclass(frozen=True)
class Slope:
    """``G``, the slope of the tree's positions in the active ones: one matrix, or one per sample.

    Attributes:
        values: Shape ``(nt, nv)`` or ``(N, nt, nv)``.
    """

    values: Array

    def columns(self, rows: Array) -> Array:
        """``rows @ G`` for rows ``(k, nt, N)`` with components first, as ``(N, k, nv)``."""
        if self.values.ndim == 2:
            return np.ascontiguousarray(np.tensordot(rows, self.values, axes=(1, 0)).swapaxes(0, 1))
        return np.moveaxis(rows, -1, 0) @ self.values

    def torque(self, tree_torque: Array) -> Array:
        """``G^T`` times torques ``(nt, N)`` of the tree, as ``(N, nv)``."""
        if self.values.ndim == 2:
            return tree_torque.T @ self.values
        return np.einsum("nti,tn->ni", self.values, tree_torque)

    def each(self, samples: int) -> Array:
        """Shape ``(N, nt, nv)`` in any case."""
        return np.broadcast_to(self.values, (samples, *self.values.shape[-2:]))


def tree_positions(model: MapModel, q: Array) -> tuple[Array, Slope]:
    """Positions of the tree's joints, shape ``(nt, N)``, and their slope, at active positions ``(N, nv)``."""
    if model.solve is None:
        return model.linear_map @ q.T + model.offset[:, None], Slope(model.linear_map)
    positions, slopes = model.solve(q)
    return positions.T, Slope(slopes)


def within_limits(model: MapModel, q: Array) -> Array:
    """True where no joint of the tree is beyond its range, and the chain can be closed, shape ``(N,)``."""
    positions, _ = tree_positions(model, q)
    slack = 1e-9
    inside = np.ones(len(q), dtype=bool)
    for joint, values in enumerate(positions):
        low, high = model.lower[joint] - slack, model.upper[joint] + slack
        if joint not in model.active and model.tree.angular[joint].any() and np.isfinite(low):
            # A passive angle that followed its expression round the circle is the same angle a turn away.
            values = low + np.mod(values - low, 2 * np.pi)
        inside &= (values >= low) & (values <= high)  # NaN is neither
    return inside


def tip_of(model: MapModel, q: Array) -> tuple[Array, Array]:
    """Tip ``(N, 3)`` [m] in the root frame and its translational Jacobian ``(N, 3, nv)`` at ``(N, nv)``."""
    positions, slope = tree_positions(model, q)
    at = poses(model.tree, positions, model.tree.tip_path)
    return tip_position(model.tree, at).T, slope.columns(tip_jacobian(model.tree, at))


@dataclass(frozen=True)
class JointSpace:
    """A block of samples in joint space.

    Attributes:
        J: Translational Jacobian of the tip in the root frame, shape ``(N, 3, nv)``.
        M: Mass matrix with rotors, shape ``(N, nv, nv)``; None if not asked for.
        weight: Torque that holds the robot against gravity, shape ``(N, nv)``; None if not asked for.
        slope: Of the tree in the active joints.
    """

    J: Array
    M: Array | None
    weight: Array | None
    slope: Slope


def joint_space(model: MapModel, q: Array, *, inertia: bool) -> JointSpace:
    """Jacobian, and mass matrix and weight if ``inertia``, at active positions ``(N, nv)``."""
    positions, slope = tree_positions(model, q)
    at = poses(model.tree, positions, None if inertia else model.tree.tip_path)
    J = slope.columns(tip_jacobian(model.tree, at))
    if not inertia:
        return JointSpace(J, None, None, slope)
    tree_mass, tree_weight = mass_and_weight(model.tree, at)
    index = np.arange(len(model.tree.parents))
    tree_mass[index, index] += model.tree.armature[:, None]
    G = slope.values
    if G.ndim == 2:
        M = np.tensordot(np.tensordot(G, tree_mass, axes=(0, 0)), G, axes=(1, 0)).swapaxes(0, 1)
    else:
        M = np.swapaxes(G, 1, 2) @ np.moveaxis(tree_mass, -1, 0) @ G
    return JointSpace(J, np.ascontiguousarray(M), slope.torque(tree_weight), slope)


def projected_friction(model: MapModel, slope: Slope, samples: int) -> tuple[Array, Array]:
    """Viscous matrix ``(N, nv, nv)`` and Coulomb torques ``(N, nv)`` on the active joints.

    The Coulomb torque of a passive joint counts with the sign that is worst for each active joint.
    """
    G = slope.each(samples)
    if slope.values.ndim == 2:
        viscous = np.broadcast_to(slope.values.T @ (model.viscous[:, None] * slope.values), (samples, *G.shape[2:] * 2))
        coulomb = np.broadcast_to(np.abs(slope.values).T @ model.coulomb, (samples, G.shape[2]))
        return viscous, coulomb
    return np.swapaxes(G, 1, 2) @ (model.viscous[:, None] * G), np.einsum("nti,t->ni", np.abs(G), model.coulomb)
