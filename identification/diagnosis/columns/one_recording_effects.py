"""Effects that act in one of several recordings only, and models that hold in one recording only.

If something unknown changed in a recording, each effect that may have changed gets additional columns, which are zero
in all other recordings. A recording with a known load or controller gets its own model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.data.change_kinds import KINDS, Kind
from identification.data.changes import Change, robot_in
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effects_of
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

# For each kind of change, the values of `Effect.changes_with` of the effects that may change. The kind ``payload`` is
# not listed: an unknown payload is a point mass of its recording.
_CHANGES: dict[Kind, tuple[str, ...]] = {
    "friction": ("friction",),
    "temperature": ("friction", "temperature"),
    "controller": ("controller",),
}


class OneRecordingEffect(Effect):
    """An effect of the catalogue that acts in one recording only: its columns are zero in all others.

    Attributes:
        inner: The effect of the catalogue.
        recording: Index of the recording where it acts, from 0.
        file: Name of that recording.
    """

    def __init__(self, inner: Effect, recording: int, file: str):
        self.inner, self.recording, self.file = inner, recording, file
        self.name = name_in_recording(inner.name, recording)
        self._contains = tuple(name_in_recording(name, recording) for name in inner.contains)
        self.scope, self.regime, self.words, self.acts_as = inner.scope, inner.regime, inner.words, inner.acts_as
        # A gain in one recording does not scale the torque in the others.
        self.made_of = tuple(source for source in inner.made_of if source != "whole joint")
        self.inertial, self.shows_with = inner.inertial, inner.shows_with
        # The shape is fitted to this recording alone.
        self.fitted = "plain" if inner.fitted == "shape held" else inner.fitted

    @property
    def contains(self) -> tuple[str, ...]:
        """Effects that this one contains, in the same recording."""
        return self._contains

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Places of the catalogue's effect."""
        return self.inner.places(robot)

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Shapes of the catalogue's effect."""
        return self.inner.shapes(robot, operation, joint)

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """Shapes of the catalogue's effect to try after a fit."""
        return self.inner.refined(coefficients, shape)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the catalogue's effect in the recording where it acts, and zeros in the others."""
        return zero_elsewhere(self.recording, operation, self.inner.signature(robot, operation, joint, shape))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds of the coefficients, which are differences from the other recordings.

        Differences have no bounds, as friction may be smaller than in the other recordings. Effects whose shape is
        estimated keep the bounds of the catalogue's effect, as a delay cannot be negative.
        """
        return self.inner.coefficient_bounds(robot, joint, shape) if self.shape_is_estimate else ()

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Why the recordings cannot show the catalogue's effect; None if they can."""
        return self.inner.untestable(robot, operation, joint)

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Regressor columns of the catalogue's effect; this effect has copies of them for its recording."""
        return self.inner.regressor_columns(robot, joint)

    def lightest(self, robot: Robot) -> float:
        """Least mass [kg] of the catalogue's effect."""
        return self.inner.lightest(robot)

    def own_inertia(self, robot: Robot, mass: float) -> Float[Array, " 6"]:
        """Inertia per mass [m^2] of the catalogue's effect about its own centre."""
        return self.inner.own_inertia(robot, mass)

    def stated_law(
        self, robot: Robot, joint: str | None, shape: Shape, std: Array, coefficients: Array
    ) -> tuple[tuple[Parameter, ...], Callable[[Array], Array]]:
        """Parameters that a finding of the catalogue's effect states, and their function of a fit's coefficients."""
        return self.inner.stated_law(robot, joint, shape, std, coefficients)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Parameters of the catalogue's effect, as differences from the other recordings, without a plausible range."""
        return tuple(replace(one, plausible=None) for one in self.inner.parameters(robot, joint))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Parameters of the catalogue's effect from the coefficients of its columns."""
        return self.inner.from_coefficients(robot, joint, coefficients, shape)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Parameter that is the size of the catalogue's effect, and the coefficients of one unit of it."""
        return self.inner.probe(robot, operation, joint)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Torque of the catalogue's effect in the recording where it acts, and zeros in the others."""
        if operation.recording != self.recording:
            return np.zeros_like(operation.tau)
        return self.inner.torque(robot, operation, joint, theta)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The catalogue's effect in a simulation, which is always of one recording."""
        return self.inner.simulated(robot, joint, theta)


def changed_effects(kind: Kind, robot: Robot) -> tuple[Effect, ...]:
    """Effects that a kind of change between two recordings of a robot may change."""
    if kind == "payload":
        return tuple(effect for effect in effects_of(robot) if effect.inertial == "point mass")
    return tuple(effect for change in _CHANGES[kind] for effect in effects_of(robot) if effect.changes_with == change)


def name_in_recording(name: str, recording: int) -> str:
    """Unique name of an effect that acts in one recording only."""
    return f"{name}@{recording}"


def zero_elsewhere(recording: int, operation: Operation, signature: Signature) -> Signature:
    """A signature that is zero in all recordings but one."""
    if operation.recording == recording:
        return signature
    steps = None if signature.steps is None else np.zeros_like(signature.steps)
    return replace(signature, columns=np.zeros_like(signature.columns), steps=steps)


@dataclass(frozen=True)
class Differences:
    """Known and unknown differences between recordings.

    Attributes:
        robots: The model of each recording; empty if the given model holds for all.
        effects: Effects that act in one recording only.
    """

    robots: tuple[Robot, ...] = ()
    effects: tuple[OneRecordingEffect, ...] = ()

    def robot(self, given: Robot, recording: int) -> Robot:
        """The model of one recording."""
        return self.robots[recording] if self.robots else given


NO_DIFFERENCES = Differences()


def differences_of(changes: tuple[Change, ...], robot: Robot, fitted: int) -> Differences:
    """Models of recordings by known changes, and effects in single recordings by unknown changes.

    For each kind of unknown change, all recordings that do not state the change share one value. If all recordings
    state it, the first recording is the reference.

    Args:
        changes: One for each recording, those held out at the end; empty if nothing is known.
        robot: The given model.
        fitted: Number of recordings that are not held out.

    Raises:
        LogError: If an unknown amount is in held-out recordings only, or payloads of several recordings are unknown.
    """
    if not changes:
        return NO_DIFFERENCES
    for change in changes[fitted:]:
        if change.unknown:
            raise LogError(
                f"{change.file} is held out, so no fit sees what changed in it: give it as LOG, or take "
                f"{', '.join(change.unknown)} out of what changed."
            )
    unknown_loads = [change.file for change in changes if "payload" in change.unknown]
    if len(unknown_loads) > 1:
        raise LogError(
            f"{' and '.join(unknown_loads)} each have a payload without a value, and fits find one of them at a time: "
            "give mass and center of the others under payload, or leave these recordings out."
        )
    if fitted == 1 and changes[0].unknown:
        raise LogError(
            f"{changes[0].file} is the only recording that fits see, so {', '.join(changes[0].unknown)} cannot have "
            "changed: give another LOG to compare it with, or leave changed out."
        )
    own = {}
    for kind in KINDS:
        effects = changed_effects(kind, robot)
        stated = [k for k, change in enumerate(changes[:fitted]) if kind in change.unknown]
        for k in stated[1:] if len(stated) == fitted else stated:
            own.update({(effect.name, k): OneRecordingEffect(effect, k, changes[k].file) for effect in effects})
    return Differences(tuple(robot_in(robot, change) for change in changes), tuple(own.values()))
