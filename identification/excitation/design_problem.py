"""The design of an excitation as a function of its weights: cost, limited quantities, and exact slopes of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identification.excitation.criteria import Criterion
from identification.excitation.excited_base import Base
from identification.excitation.limited_quantities import Bounds, bounds_of, places
from identification.excitation.limits import Limits
from identification.excitation.motion_shapes import Shapes
from identification.excitation.regressor_slope import regressor_slope
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray

_REACH = (np.pi, 0.5)
"""Half of the range [rad; m for linear joints] in which a joint without position limits is placed."""


@dataclass(frozen=True)
class Grid:
    """Shapes at N times: ``values`` has position, velocity and acceleration of each shape, ``(3, N, K)``."""

    t: Float[Array, " N"]
    values: Float[Array, "3 N K"]

    @classmethod
    def of(cls, shapes: Shapes, samples: int) -> Grid:
        """A grid of equal steps with both ends."""
        t = np.linspace(0.0, shapes.duration, samples)
        return cls(t, shapes.values(t))

    def motion(self, weights: Float[Array, "K nv"]) -> Motion:
        """The motion whose joints have the given weights of the shapes."""
        return Motion(self.t, *(self.values @ weights))


@dataclass(frozen=True)
class DesignProblem:
    """What is to be designed.

    Attributes:
        robot: A plain robot, or a chain of linear loops.
        base: Its base parameters, and what is known of them.
        criterion: What makes the experiment good.
        limits: What the motion keeps.
    """

    robot: Robot
    base: Base
    criterion: Criterion
    limits: Limits

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds of everything that is limited."""
        return bounds_of(self.robot, self.limits)

    @cached_property
    def to_tree(self) -> Float[Array, "nt nv"]:
        """Velocities of the tree per velocity of the active joints."""
        return np.eye(self.robot.nv) if self.robot.chain is None else np.array(self.robot.chain.linear_map)

    @cached_property
    def offset(self) -> Float[Array, " nt"]:
        """Positions of the tree where those of the active joints are zero."""
        return np.zeros(self.robot.nv) if self.robot.chain is None else np.array(self.robot.chain.offset)

    @cached_property
    def _viscous(self) -> Float[Array, "nv nv"]:
        own = np.diag(self.robot.viscous_friction)
        chain = self.robot.chain
        if chain is None:
            return own
        rows = self.to_tree[list(chain.passive)]
        return own + rows.T @ (chain.viscous_friction[:, None] * rows)

    @cached_property
    def _rotors(self) -> Float[Array, "nv nv"]:
        return self.to_tree.T @ (np.asarray(self.robot.model.armature)[:, None] * self.to_tree)

    def information(self, W: Float[Array, "N nv p"]) -> Float[Array, "r r"]:
        """Information matrix of a motion's regressor together with what is known."""
        rows = self.base.rows(W)
        return self.base.known + rows.T @ rows / len(W)

    def regressor(self, motion: Motion) -> Float[Array, "N nv p"]:
        """Rigid-body regressor of a motion."""
        return rigid_body_regressor(self.robot, motion)

    def limited(self, motion: Motion, W: Float[Array, "N nv p"]) -> Float[Array, "N m"]:
        """Everything that is limited, in the order of the bounds."""
        return self._limited(motion, W, slopes=False)[0]

    def _limited(
        self, motion: Motion, W: Float[Array, "N nv p"], *, slopes: bool
    ) -> tuple[Float[Array, "N m"], Float[Array, "N l nt"] | None]:
        tau = W @ standard_parameters(self.robot) + motion.a @ self._rotors + motion.v @ self._viscous
        tree_q = motion.q @ self.to_tree.T + self.offset
        parts = [tree_q, motion.v @ self.to_tree.T, motion.a, tau]
        if not self.limits.boxes and self.limits.collisions is None:
            return np.concatenate(parts, axis=1), None
        placed, slope = places(
            self.robot.model, self.limits, self.robot.configuration(np.array(motion.q)), slopes=slopes
        )
        return np.concatenate([*parts, placed], axis=1), slope

    def cost(
        self,
        grid: Grid,
        weights: Float[Array, "K nv"],
        penalty: Callable[[Float[Array, "N m"]], tuple[float, Float[Array, "N m"]]],
        criterion: Criterion | None = None,
    ) -> tuple[float, Float[Array, "K nv"]]:
        """Criterion and penalty of a motion, and the slope of their sum in the weights.

        Args:
            grid: Where the motion is looked at.
            weights: Of the shapes, for each joint.
            penalty: Of everything that is limited, with its slope.
            criterion: In place of the problem's own.
        """
        motion = grid.motion(weights)
        W = self.regressor(motion)
        value, of_information = (criterion or self.criterion).cost(self.information(W))
        limited, placed_slope = self._limited(motion, W, slopes=True)
        paid, pull = penalty(limited)
        S = self.base.pulled_back(W, of_information)
        nt, nv = self.to_tree.shape
        of_q, of_v, of_a, of_tau, of_places = np.split(pull, np.cumsum([nt, nt, nv, nv]), axis=1)
        S += of_tau[:, :, None] * standard_parameters(self.robot)
        tree = self.to_tree
        _, slope = regressor_slope(
            self.robot.model,
            motion.q @ tree.T + self.offset,
            motion.v @ tree.T,
            motion.a @ tree.T,
            S if self.robot.chain is None else np.einsum("ti,nip->ntp", tree, S),
        )
        tree_q = slope.q + of_q
        if placed_slope is not None:
            tree_q = tree_q + np.einsum("nm,nmt->nt", of_places, placed_slope)
        active = (
            tree_q @ tree,
            (slope.v + of_v) @ tree + of_tau @ self._viscous,
            slope.a @ tree + of_a + of_tau @ self._rotors,
        )
        gradient = sum(part.T @ pulled for part, pulled in zip(grid.values, active, strict=True))
        return value + paid, np.asarray(gradient)


@dataclass(frozen=True)
class JointSizes:
    """Middle and half range of each active joint's position [rad or m], and its largest speed."""

    middle: Float[Array, " nv"]
    half: Float[Array, " nv"]
    speed: Float[Array, " nv"]


def joint_sizes(problem: DesignProblem) -> JointSizes:
    """Sizes from the limits; a joint that may go further than half a turn either way stays within one turn."""
    rows, limits = list(problem.robot.tree_rows), problem.limits
    reach = np.where(problem.robot.prismatic, _REACH[1], _REACH[0])
    lower, upper = limits.lower[rows], limits.upper[rows]
    middle = np.clip(
        0.0, lower + np.minimum(reach, (upper - lower) / 2), upper - np.minimum(reach, (upper - lower) / 2)
    )
    half = np.minimum(np.minimum(upper - middle, middle - lower), reach)
    speed = np.minimum(limits.velocity[rows], np.where(problem.robot.prismatic, 10.0, 100.0))
    return JointSizes(middle, half, speed)
