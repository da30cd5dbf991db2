"""The optimisation problem of an exciting motion, with exact derivatives of the cost and of all limited quantities.

The unknowns are the weights of the motion's shapes. The cost is a criterion of the information matrix of the base
parameters (see `criteria.py`). Earlier recordings add to the information. An ordinary motion is a random one, with
postures in the whole range, about 1 rad/s and 1 rad/s^2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.excitation.closable import ordinary_postures, solved_numerically, with_start_between
from identification.excitation.criteria import Criterion
from identification.excitation.limits import Bounds, Limits, bounds_of, places
from identification.excitation.motion_shapes import Shapes
from identification.excitation.regressor_slope import regressor_slope
from identification.excitation.tree_gradient import TreeGradient, gradient_of_active, singularity_distance
from identification.regression.base_parameters import base_parameters_of_matrix
from identification.regression.triangular import r_factor
from phantom_dyn._kernels import rigid_body
from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.dynamics.moving_base import any_base_motion
from phantom_dyn.dynamics.tree_motion import TreeMotion, apply, project, tree_friction, tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream

_ORDINARY_SAMPLES = 400  # number of samples of the ordinary motion from which sizes are computed


@dataclass(frozen=True)
class Base(ReadOnlyArrays):
    """Base parameters of a design, as columns of the regressor.

    Attributes:
        columns: Indices of the r independent columns among the standard parameters.
        sizes: Root mean square of each of these columns in an ordinary motion, shape ``(r,)``.
        noise: Torque noise by which each joint's rows are divided, shape ``(nv,)``.
        known: Information of earlier recordings divided by the number of planned samples, with columns divided by
            ``sizes``, shape ``(r, r)``.
    """

    columns: tuple[int, ...]
    sizes: Float[Array, " r"]
    noise: Float[Array, " nv"]
    known: Float[Array, "r r"]

    def rows(self, W: Float[Array, "N nv p"]) -> Float[Array, "M r"]:
        """Rows of a regressor, divided by noise and sizes."""
        return ((W / self.noise[:, None])[:, :, list(self.columns)] / self.sizes).reshape(-1, len(self.columns))

    def by_regressor(self, W: Float[Array, "N nv p"], by_information: Float[Array, "r r"]) -> Float[Array, "N nv p"]:
        """Derivative of a scalar by each entry of a regressor, from its derivative by the information matrix."""
        out = np.zeros_like(W)
        slope = 2.0 / len(W) * self.rows(W) @ by_information
        out[:, :, list(self.columns)] = slope.reshape(*W.shape[:2], -1) / self.sizes / self.noise[:, None]
        return out


def base_of(
    robot: Robot,
    *,
    planned: float = 1.0,
    noise: float | Sequence[float] | None = None,
    earlier: Float[Array, "k p"] | None = None,
) -> Base:
    """Base parameters of a robot for a design.

    Args:
        robot: The robot.
        planned: Number of samples of the planned recording, which determines its weight relative to ``earlier``.
        noise: Torque noise [N m or N] of each joint, or one number; 1 by default.
        earlier: Triangular factor of the regressor of earlier recordings, from `earlier_factor`.

    Raises:
        ParameterError: If the factor is that of another robot, or the noise is not positive.
    """
    sigma = _noise(robot, noise)
    names = parameter_names(robot)
    if earlier is not None and (earlier.shape[1] != len(names) or not np.isfinite(earlier).all()):
        raise ParameterError(
            f"The factor of earlier recordings has the shape {earlier.shape}, and {robot.name} has {len(names)} "
            "standard parameters: make it with earlier_factor for this robot."
        )
    W = _ordinary_rows(robot) / sigma[:, None]
    rows = W.reshape(-1, len(names))
    columns = list(base_parameters_of_matrix(rows, names, parameter_units(robot)).independent)
    sizes = np.sqrt((rows[:, columns] ** 2).sum(axis=0) / len(W))
    known = np.zeros((len(columns), len(columns)))
    if earlier is not None:
        scaled = earlier[:, columns] / sizes
        known = scaled.T @ scaled / planned
    return Base(tuple(columns), sizes, sigma, known)


def earlier_factor(robot: Robot, motions: Iterable[Motion]) -> Float[Array, "k p"]:
    """Triangular factor of the regressor of recorded motions, shape ``(k, p)``.

    Args:
        robot: The robot.
        motions: Recorded motions. The noise of their samples should be nearly independent.
    """
    return r_factor(rigid_body_regressor(robot, motion) for motion in motions)


def _noise(robot: Robot, noise: float | Sequence[float] | None) -> Float[Array, " nv"]:
    """Torque noise of each joint [N m or N], after a check; 1 if none is given."""
    values = np.atleast_1d(np.asarray(1.0 if noise is None else noise, dtype=float))
    if values.shape not in ((1,), (robot.nv,)) or not (np.isfinite(values) & (values > 0)).all():
        raise ParameterError(
            f"The noise {values} was given for {robot.nv} joints: give a number above 0, or one for each joint."
        )
    return np.broadcast_to(values, (robot.nv,))


def _ordinary_rows(robot: Robot) -> Float[Array, "N nv p"]:
    """Regressor of independent samples that excite all parameters."""
    motion = _ordinary_motion(robot)
    if not solved_numerically(robot):
        return rigid_body_regressor(robot, motion)
    postures = ordinary_postures(robot, _ORDINARY_SAMPLES)
    v, a = (np.repeat(part[: len(postures)], 2, axis=0) for part in (motion.v, motion.a))
    q = with_start_between(robot, postures)
    return rigid_body_regressor(robot, Motion(np.arange(float(len(q))), q, v, a))[1::2]


def _ordinary_motion(robot: Robot) -> Motion:
    """Independent random samples that excite all parameters, with about 1 rad/s and 1 rad/s^2."""
    rng = random_stream("ordinary motion")
    q = rng.uniform(-np.pi, np.pi, (_ORDINARY_SAMPLES, robot.nv)) * np.where(robot.prismatic, 0.1, 1.0)
    v, a = rng.normal(size=(2, _ORDINARY_SAMPLES, robot.nv)) * np.where(robot.prismatic, 0.3, 1.0)
    base = any_base_motion(rng, _ORDINARY_SAMPLES) if robot.floating else None
    return Motion(np.arange(float(_ORDINARY_SAMPLES)), q, v, a, base=base)


_REACH = (np.pi, 0.5)
"""Half of the range of a joint without position limits [rad; m for linear joints]."""


@dataclass(frozen=True)
class Grid:
    """Shape functions at N times ``t`` [s]; ``values`` are positions, velocities and accelerations, ``(3, N, K)``."""

    t: Float[Array, " N"]
    values: Float[Array, "3 N K"]

    @classmethod
    def of(cls, shapes: Shapes, samples: int) -> Grid:
        """A grid of equal steps that includes both ends."""
        t = np.linspace(0.0, shapes.duration, samples)
        return cls(t, shapes.values(t))

    def motion(self, weights: Float[Array, "K nv"]) -> Motion:
        """The motion in which the position of each joint is the weighted sum of the shapes."""
        return Motion(self.t, *(self.values @ weights))


@dataclass(frozen=True)
class DesignProblem:
    """A robot, a criterion and the limits of a motion.

    Attributes:
        robot: The robot, which may contain closed chains.
        base: Base parameters of the robot, and information of earlier recordings.
        criterion: Criterion of the experiment.
        limits: Limits of the motion.
    """

    robot: Robot
    base: Base
    criterion: Criterion
    limits: Limits

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds of all limited quantities."""
        return bounds_of(self.robot, self.limits)

    @cached_property
    def _viscous(self) -> Float[Array, " nt"]:
        """Coefficient of viscous friction of each joint of the tree."""
        return tree_friction(self.robot)[0]

    def _drive_torque(self, tree: TreeMotion) -> Float[Array, "N nt"]:
        """Torque of rotors and viscous friction on the joints of the tree, shape ``(N, nt)``."""
        return np.asarray(self.robot.model.armature) * tree.a + self._viscous * tree.v

    def information(self, W: Float[Array, "N nv p"]) -> Float[Array, "r r"]:
        """Information matrix of a motion's regressor, plus the information of earlier recordings."""
        rows = self.base.rows(W)
        return self.base.known + rows.T @ rows / len(W)

    def regressor(self, motion: Motion) -> Float[Array, "N nv p"]:
        """Rigid-body regressor of a motion."""
        return rigid_body_regressor(self.robot, motion)

    def limited(self, motion: Motion, W: Float[Array, "N nv p"]) -> Float[Array, "N m"]:
        """All limited quantities in the order of the bounds, shape ``(N, m)``."""
        return self._limited(motion, W, slopes=False)[0]

    def _limited(
        self, motion: Motion, W: Float[Array, "N nv p"], *, slopes: bool
    ) -> tuple[Float[Array, "N m"], Float[Array, "N l nt"] | None]:
        """All limited quantities, and derivatives of the last ``l`` (frames and bodies) by the tree's positions."""
        tree = tree_motion(self.robot, motion)
        tau = W @ standard_parameters(self.robot) + project(tree.G, self._drive_torque(tree))
        parts = [tree.q, tree.v, motion.a, tau, singularity_distance(self.robot, motion)]
        if not self.limits.boxes and self.limits.collisions is None:
            return np.concatenate(parts, axis=1), None
        placed, slope = places(self.robot.model, self.limits, tree.configuration, slopes=slopes)
        return np.concatenate([*parts, placed], axis=1), slope

    def cost(
        self,
        grid: Grid,
        weights: Float[Array, "K nv"],
        penalty: Callable[[Float[Array, "N m"]], tuple[float, Float[Array, "N m"]]],
        criterion: Criterion | None = None,
    ) -> tuple[float, Float[Array, "K nv"]]:
        """Criterion plus penalty of a motion, and the derivative of the sum by the weights, shape ``(K, nv)``.

        Args:
            grid: Samples at which the motion is evaluated.
            weights: Weights of the shapes for each joint, shape ``(K, nv)``.
            penalty: Penalty of the limited quantities, with its derivative.
            criterion: Criterion instead of the problem's; None for the problem's.

        Raises:
            ChainError: If a chain cannot be closed along the motion, or is singular.
        """
        motion = grid.motion(weights)
        W = self.regressor(motion)
        value, by_information = (criterion or self.criterion).cost(self.information(W))
        limited, place_slopes = self._limited(motion, W, slopes=True)
        excess_cost, by_limited = penalty(limited)
        tree, numeric = tree_motion(self.robot, motion), solved_numerically(self.robot)
        nt, nv = tree.G.shape[1:]
        # Limited quantities in order: positions and velocities of the tree, accelerations and torques of the active
        # joints, distance from a singularity, coordinates of frames and distances of bodies.
        cuts = np.cumsum([nt, nt, nv, nv, int(numeric)])
        by_q, by_v, by_a, by_tau, by_distance, by_places = np.split(by_limited, cuts, axis=1)
        by_W = self.base.by_regressor(W, by_information)
        by_W += by_tau[:, :, None] * standard_parameters(self.robot)
        by_tree_W = by_W if self.robot.chain is None else np.einsum("nti,nip->ntp", tree.G, by_W, optimize=True)
        _, slope = regressor_slope(self.robot.model, tree.q, tree.v, tree.a, by_tree_W)
        if place_slopes is not None:
            by_q = by_q + np.einsum("nm,nmt->nt", by_places, place_slopes)
        by_tree_torque = apply(tree.G, by_tau)
        by_tree = TreeGradient(
            slope.q + by_q,
            slope.v + by_v + self._viscous * by_tree_torque,
            slope.a + np.asarray(self.robot.model.armature) * by_tree_torque,
            self._by_projection(tree, by_W, by_tau) if numeric else np.zeros_like(tree.G),
            by_distance.sum(axis=1),
        )
        active = gradient_of_active(self.robot, motion, tree, by_tree)
        slopes = (active[0], active[1], active[2] + by_a)
        gradient = sum(values.T @ by_values for values, by_values in zip(grid.values, slopes, strict=True))
        return value + excess_cost, np.asarray(gradient)

    def _by_projection(
        self, tree: TreeMotion, by_W: Float[Array, "N nv p"], by_tau: Float[Array, "N nv"]
    ) -> Float[Array, "N nt nv"]:
        """Derivative of the cost by the matrix ``G`` that maps active velocities to velocities of the tree.

        ``G`` enters the cost because its transpose projects the tree's regressor and drive torque to the active joints.
        """
        model, arrays = self.robot.model, self.robot.arrays
        W = rigid_body.regressor(model, arrays, tree.configuration, tree.v, tree.a)
        from_regressor = np.einsum("ntp,nip->nti", W, by_W, optimize=True)
        return from_regressor + self._drive_torque(tree)[:, :, None] * by_tau[:, None]


@dataclass(frozen=True)
class JointSizes:
    """Middle and half range of each active joint's position [rad or m], and its largest speed, each ``(nv,)``."""

    middle: Float[Array, " nv"]
    half: Float[Array, " nv"]
    speed: Float[Array, " nv"]


def joint_sizes(problem: DesignProblem) -> JointSizes:
    """Sizes of the joints from their limits.

    If the limits allow more than one turn, the range is one turn: about zero, or about the start posture of a closed
    chain that is solved numerically.
    """
    rows, limits = list(problem.robot.tree_rows), problem.limits
    reach = np.where(problem.robot.prismatic, _REACH[1], _REACH[0])
    lower, upper = limits.lower[rows], limits.upper[rows]
    chain = problem.robot.chain
    near = chain.start[rows] if chain is not None and solved_numerically(problem.robot) else 0.0
    room = np.minimum(reach, (upper - lower) / 2)
    middle = np.clip(near, lower + room, upper - room)
    half = np.minimum(np.minimum(upper - middle, middle - lower), reach)
    speed = np.minimum(limits.velocity[rows], np.where(problem.robot.prismatic, 10.0, 100.0))
    return JointSizes(middle, half, speed)
