"""Friction or inertia of a part that turns with two joints, at the velocity ``w = v_i + ratio v_j``.

Such a part is a belt, a differential, or a bearing between two links with parallel axes. Its torque
``-(T sign(w) + c w + I dw/dt)`` acts on joint i, and ``ratio`` times this torque on joint j. If only one of the joints
moves, the effect looks like friction of this joint; motions with both joints in phase and out of phase separate the
two. MJCF: a fixed ``tendon`` with ``frictionloss``, ``damping`` and ``armature``; URDF has no place for it.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    damping_unit,
    inertia_unit,
    row_of,
    torque_law,
    torque_unit,
)
from phantom_dyn.effects.described import Coupling
from phantom_dyn.effects.support.rows import stated_limit, torque_on_rows

# Largest number of joints of an arm on which all pairs are searched. On longer arms a belt skips at most one joint.
_ALL_PAIRS = 4
# Travel below which a joint counts as at rest [rad or m].
_AT_REST = 1e-4
# Correlation of two velocities above which they count as proportional. If a planner starts all joints together, the
# correlation reaches 0.9.
_PROPORTIONAL = 0.97


class JointCoupling(Effect):
    """Friction or inertia that moves with two joints."""

    name = "joint_coupling"
    scope = "pair"
    regime = "velocity_reversal"
    made_of = ("acceleration",)
    words = EffectWords(
        name="joint coupling",
        meaning="friction or inertia that acts when both joints move, as in a coupled transmission",
        next_step="Record the two joints moving in phase, then out of phase, and model the coupled transmission.",
        size="through the first joint's velocity plus {ratio} times the second's",
        parameters={
            "ratio": "how much the second joint's speed counts against the first's",
            "coulomb_torque": "constant friction torque of the coupled motion",
            "coefficient": "friction torque per unit of coupled speed",
            "inertia": "inertia that moves with the coupled speed",
        },
        shown_over=("coupled_velocity",),
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Pairs of joints: all of them on a short arm, otherwise those with at most one joint in between."""
        names = robot.joint_names
        reach = len(names) if len(names) <= _ALL_PAIRS else 2
        return tuple(f"{names[i]}+{names[j]}" for i, j in combinations(range(len(names)), 2) if j - i <= reach)

    def can_sit(self, robot: Robot, joint: str | None) -> bool:
        """True for any two different joints."""
        pair = (joint or "").split("+")
        return len(pair) == len(set(pair)) == 2 and set(pair) <= set(robot.joint_names)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``ratio`` of the second joint, then friction and inertia on the side of the first."""
        first = robot.joint_names[_pair(robot, joint)[0]]
        return (
            Parameter(
                "ratio",
                "1",
                plausible=(-10.0, 10.0),
                plausible_because="wheels of one coupled transmission differ by less than a factor of ten",
            ),
            Parameter(
                "coulomb_torque",
                torque_unit(robot, first),
                0.0,
                plausible=(0.0, stated_limit(robot, first)),
                plausible_because="a joint whose friction is more than its drive can give does not move",
            ),
            Parameter(
                "coefficient",
                damping_unit(robot, first),
                0.0,
                plausible=(0.0, np.inf),
                plausible_because="friction takes energy, and cold grease may take any amount",
            ),
            Parameter(
                "inertia",
                inertia_unit(robot, first),
                0.0,
                plausible=(0.0, np.inf),
                plausible_because="an inertia is positive, and that of a rotor behind a gear may be large",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Ratios to try first: 1 (sum of the two velocities) and -1 (their difference)."""
        return ((1.0,), (-1.0,))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same ratio, and some smaller and larger ones."""
        return tuple((factor * shape[0],) for factor in (0.8, 0.93, 1.0, 1.07, 1.25))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Sign, velocity and acceleration of the coupled motion ``w``; the rows are both joints."""
        rows = _pair(robot, joint)
        w, dw = (_combined(x, rows, shape[0]) for x in (operation.v, operation.a))
        columns = np.stack([np.sign(w), w, dw], axis=-1)
        first = self.parameters(robot, joint)[1:]
        return Signature(
            rows,
            np.stack([columns, shape[0] * columns], axis=1),
            tuple(p.name for p in first),
            tuple(p.unit for p in first),
        )

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bounds of zero: friction and inertia cannot be negative."""
        return ((0.0, np.inf),) * 3

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The ratio, which is the shape, then the coefficients."""
        return np.array([shape[0], *coefficients])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The size is the Coulomb friction of the coupling; the coefficients are those of an effect of size one."""
        return "coulomb_torque", np.array([1.0, 0.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if a joint does not move, or both move in proportion: a coupling then looks like friction of each."""
        rows = _pair(robot, joint)
        for row in rows:
            low, high = np.percentile(operation.q[:, row], [1, 99])
            if high - low < _AT_REST:
                return f"{robot.joint_names[row]} does not move: a coupling looks like friction of the other joint"
        one, two = (operation.v[:, row] for row in rows)
        if abs(float(one @ two)) > _PROPORTIONAL * float(np.linalg.norm(one) * np.linalg.norm(two)):
            names = " and ".join(robot.joint_names[row] for row in rows)
            return f"{names} move along one line: a coupling looks like friction of each"
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Torque on joint i, and ``ratio`` times this torque on joint j."""
        rows = _pair(robot, joint)
        ratio, coulomb, viscous, inertia = theta
        w, dw = (_combined(x, rows, ratio) for x in (operation.v, operation.a))
        inner = -(coulomb * np.sign(w) + viscous * w + inertia * dw)
        return torque_on_rows(robot, rows, np.stack([inner, ratio * inner], axis=1))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Friction as a torque law, and the inertia as a part of the mass matrix."""
        rows = list(_pair(robot, joint))
        ratio, coulomb, viscous, inertia = theta
        share = np.zeros(robot.nv)
        share[rows] = 1.0, ratio
        law = Law(shared_law, rows[0], (float(coulomb), float(viscous)), other=rows[1], share=float(ratio))
        return Simulated(inertia=inertia * np.outer(share, share), laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The coupling, which describes the effect completely."""
        first, _, second = (joint or "").partition("+")
        return ModelNumbers(whole=True, coupling=Coupling(first, second, *(float(x) for x in theta)))


def _pair(robot: Robot, joint: str | None) -> tuple[int, int]:
    first, _, second = (joint or "").partition("+")
    return row_of(robot, first), row_of(robot, second)


def _combined(x: Float[Array, "N nv"], rows: tuple[int, int], ratio: float) -> Float[Array, " N"]:
    return x[:, rows[0]] + ratio * x[:, rows[1]]


@torque_law
@jit
def shared_law(v: float, coulomb: float, viscous: float) -> float:
    """Friction of the part that turns with both joints, at its velocity ``v``."""
    return -(coulomb * np.sign(v) + viscous * v)
