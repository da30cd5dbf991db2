"""Friction that grows with the load: ``torque = -ratio |tl| sign(v)``, where the transmission passes the torque ``tl``.

At every reversal the measured torque jumps in proportion to the load. If the load hardly changes, the effect looks like
Coulomb friction: postures far apart or two payloads separate them. The load is computed from the model with the other
findings, for example with a payload. The measured load is not used, because its noise would bias the fit. MJCF and URDF
have no place for it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    FormulaTerm,
    Law,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    SpecialCase,
    row_of,
    torque_law,
    torque_on_joint,
)
from phantom_dyn.effects.operation import up_to_band
from phantom_dyn.effects.support.rows import never_reverses

# Share of the load at which a transmission loses all of it.
_SELF_LOCKING = 1.0
# Largest share of the load that a sound gear loses, and that a screw of a linear axis loses.
_GEAR, _SCREW = 0.5, 0.9


class LoadDependentFriction(Effect):
    """Friction of one joint in proportion to its load."""

    name = "load_dependent_friction"
    regime = "high_load"
    made_of = ("acceleration", "model", "load")
    acts_as = "dry friction"
    changes_with = "friction"
    words = EffectWords(
        name="load-dependent friction",
        meaning="friction that grows with the torque that the transmission passes on",
        next_step="Record the same motion with two payloads, then scale the joint's friction with the load in "
        "the model.",
        less="less load-dependent friction than modelled",
        size="of {ratio} times the load",
        parameters={"ratio": "friction torque per torque that the transmission passes on"},
        shown_over=("transmitted",),
        lost="friction that grows with load",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``ratio`` of friction to load."""
        return (
            Parameter(
                "ratio",
                "1",
                0.0,
                _SELF_LOCKING,
                plausible=(0.0, _SCREW if robot.prismatic[row_of(robot, joint)] else _GEAR),
                plausible_because="a gear that loses more than half of what it passes is a worm or worn out, and few "
                "screws lose more than nine tenths",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: ``|tl| sign(v)``."""
        row = row_of(robot, joint)
        column = (np.abs(up_to_band(operation, operation.load[:, row])) * np.sign(operation.v[:, row]))[:, None, None]
        return Signature((row,), column, ("ratio",), ("1",), column)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds of the ratio: zero, and one, at which the transmission loses all of its load."""
        return ((0.0, _SELF_LOCKING),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No effect: a ratio of zero, or a ratio at its upper bound, where the fit does not determine it."""
        return SpecialCase((), coefficients), SpecialCase((), coefficients - _SELF_LOCKING)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the joint never reverses: the effect then looks like a wrong torque constant or an offset."""
        return never_reverses(robot, operation, joint)

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: ``|tl| sign(v)``."""
        kind = "friction that grows with load"
        return (FormulaTerm(kind, "|tl|*sign(v)", lambda tl, v: np.abs(tl) * np.sign(v), "{torque}"),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-ratio |tl| sign(v)`` on the joint."""
        row = row_of(robot, joint)
        law = -theta.item() * np.abs(up_to_band(operation, operation.load[:, row])) * np.sign(operation.v[:, row])
        return torque_on_joint(robot, joint, law)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A torque law whose friction follows the simulated load."""
        return Simulated(laws=(Law(loaded_law, row_of(robot, joint), (theta.item(),)),))


@torque_law
@jit
def loaded_law(v: float, load: float, ratio: float) -> float:
    """Friction under a transmitted torque ``load``."""
    return -ratio * abs(load) * np.sign(v)
