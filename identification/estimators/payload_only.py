# pyright: reportAttributeAccessIssue=false
"""The ten inertial parameters of a payload, with the robot's taken as known or as common to two recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from identification.data.log import Log
from identification.estimators.consistent.consistent_bodies import (
    pseudo_inertia,
    reference_bodies,
    reference_body,
    standard_of,
)
from identification.estimators.consistent.consistent_program import (
    Program,
    is_possible,
    nearest_unconstrained,
    solve_program,
)
from identification.estimators.consistent.full_parameters import coefficient_bounds, covariance_root, selection
from identification.estimators.fit import Fit
from identification.estimators.weighted_least_squares import wls
from identification.regression.regressor import EffectOnJoint, Regressor, gap_regressor, torque_regressor
from phantom_dyn.array_types import Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError, ParameterError, RobotError
from phantom_dyn.model.inertia import STANDARD_NAMES, body_name, body_parameters, payload_body
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_RADIUS = 0.05  # radius of gyration [m] that is assumed of a payload where a recording does not show it
_SLIGHT = 1e-3  # mass [kg] below which a recording does not show where a payload is


@dataclass(frozen=True)
class PayloadFit:
    """What a payload weighs and how it is distributed.

    Attributes:
        fit: Base parameters of payload and effects (and of the robot, where it was unknown) by weighted least squares;
            ``payload.m`` and so on are about the joint that moves the payload.
        body: Link that carries the payload.
        standard: A possible payload that fits best, about the joint that moves it, shape ``(10,)``; what the recording
            does not tell is as in the expected payload.
        std: Deviations of those of the ten that the recordings determine one by one, else nan, shape ``(10,)``.
        together: What it determines only in combinations, one equation each.
        unseen: What it does not show at all.
        joint_from_frame: Pose of the stated frame that carries the payload in that joint's frame, shape ``(4, 4)``;
            the identity where none was stated.
    """

    fit: Fit
    body: str
    standard: Float[Array, " 10"]
    std: Float[Array, " 10"]
    together: tuple[str, ...]
    unseen: tuple[str, ...]
    joint_from_frame: Float[Array, "4 4"]

    @property
    def determined(self) -> tuple[str, ...]:
        """Those of `phantom_dyn.model.inertia.STANDARD_NAMES` that the recordings determine one by one."""
        return tuple(name for name, std in zip(STANDARD_NAMES, self.std, strict=True) if not np.isnan(std))

    @property
    def standard_in_frame(self) -> Float[Array, " 10"]:
        """The ten parameters about the origin of the frame that carries the payload, in its axes."""
        inverse = np.linalg.inv(self.joint_from_frame)
        return standard_of(inverse @ pseudo_inertia(self.standard) @ inverse.T)


def fit_payload(
    robot: Robot,
    loaded: Log | Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    unloaded: Log | Sequence[Log] = (),
    frame: str | None = None,
    expected: Float[Array, " 10"] | None = None,
) -> PayloadFit:
    """A payload on a robot whose own parameters are taken as given.

    Args:
        robot: The robot without payload.
        loaded: Recordings with the payload.
        effects: What acts on the joints beside the model, in all recordings; recordings without payload help to tell
            it from the payload.
        unloaded: Recordings without it.
        frame: That carries the payload; by default the robot's ``payload_frame``, else the link with a frame ``tip``,
            else the last one, and then the frame of the joint that moves this link.
        expected: Ten parameters of a similar payload about the joint that moves it.

    Raises:
        RobotError: If there is no such frame on a moving link.
        LogError: If a recording is of other joints, or there is none with payload.
        IdentifiabilityError: If the recordings excite nothing.
    """
    carrying = _carrying(robot, frame)
    logs, count = _joined(loaded, unloaded)
    regressor = gap_regressor(carrying, logs, [(effect_named("payload"), None), *effects])
    return _payload_fit(_masked(regressor, count), expected)


def fit_payload_and_robot(
    robot: Robot,
    loaded: Log | Sequence[Log],
    unloaded: Log | Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    frame: str | None = None,
    expected: Float[Array, " 10"] | None = None,
) -> PayloadFit:
    """A payload as the difference of recordings: the robot's own parameters are unknown, and common to all of them.

    Args:
        robot: Gives the kinematics.
        loaded: Recordings with the payload.
        unloaded: Recordings without it.
        effects: What acts on the joints beside the rigid body, in all recordings.
        frame: See `fit_payload`.
        expected: See `fit_payload`.

    Raises:
        RobotError: If there is no such frame on a moving link.
        LogError: If a recording is of other joints, or there is none with or none without payload.
        IdentifiabilityError: If the recordings excite nothing.
    """
    carrying = _carrying(robot, frame)
    logs, count = _joined(loaded, unloaded)
    if count == len(logs):
        raise LogError("No recording without payload was given: give one, or take the robot's parameters as known.")
    regressor = torque_regressor(carrying, logs, [(effect_named("payload"), None), *effects])
    return _payload_fit(_masked(regressor, count), expected)


@dataclass(frozen=True, kw_only=True)
class _Loaded(Regressor):
    """Equations whose payload acts in the first ``loaded`` recordings only."""

    loaded: int

    @cached_property
    def W(self) -> Float[Array, "N nv p"]:
        """The whole regressor, see `Regressor.W`."""
        return self._without(super().W, 0)

    def blocks(self, columns: Sequence[int] | None = None) -> Iterator[Float[Array, "n nv p"]]:
        """Blocks of it, see `Regressor.blocks`."""
        start = 0
        for block in super().blocks():
            bare = self._without(block, start)
            yield bare if columns is None else bare[:, :, list(columns)]
            start += len(block)

    def _without(self, block: Array, start: int) -> Array:
        bare = max(self.starts[self.loaded] - start, 0)
        kept = block.copy()
        kept[bare:, :, self.first_effect : self.first_effect + 10] = 0.0
        return kept


def _masked(regressor: Regressor, loaded: int) -> _Loaded:
    return _Loaded(**{field.name: getattr(regressor, field.name) for field in fields(Regressor)}, loaded=loaded)


def _carrying(robot: Robot, frame: str | None) -> Robot:
    if frame is None:
        return robot
    model = robot.model
    if not model.existFrame(frame) or model.frames[model.getFrameId(frame)].parentJoint == 0:
        raise RobotError(f"{robot.name} has no frame '{frame}' on a moving link: give one that it has.")
    return replace(robot, payload_frame=frame)


def _joined(loaded: Log | Sequence[Log], unloaded: Log | Sequence[Log]) -> tuple[tuple[Log, ...], int]:
    first = (loaded,) if isinstance(loaded, Log) else tuple(loaded)
    second = (unloaded,) if isinstance(unloaded, Log) else tuple(unloaded)
    if not first:
        raise LogError("No recording with payload was given: give at least one.")
    return (*first, *second), len(first)


def _payload_fit(regressor: Regressor, expected: Array | None) -> PayloadFit:
    robot, first = regressor.robot, regressor.first_effect
    fit = wls(regressor)
    own = range(first, first + 10)
    std, together, unseen = np.full(10, np.nan), [], []
    places = {k: row for row, k in enumerate(fit.base.independent)}
    for k in own:
        if k in fit.base.zero:
            unseen.append(STANDARD_NAMES[k - first])
        elif k in places and not fit.names[places[k]].endswith("R"):
            std[k - first] = fit.std()[places[k]]
    names = {regressor.names[k] for k in own}
    together = [line for line in fit.base.regroupings() if names & set(line.replace("R =", " =").split())]
    body = payload_body(robot)
    return PayloadFit(
        fit,
        body_name(robot, body),
        _possible(regressor, fit, expected)[first : first + 10],
        std,
        tuple(together),
        tuple(unseen),
        _pose(robot),
    )


def _possible(regressor: Regressor, fit: Fit, expected: Array | None) -> Array:
    first = regressor.first_effect
    payload = _expected(fit, first) if expected is None else np.asarray(expected, dtype=float)
    if payload.shape != (10,) or not np.isfinite(payload).all():
        raise ParameterError("The expected payload is not ten finite numbers: give m, mx, my, mz, Ixx to Izz.")
    robot = standard_parameters(regressor.robot) if first else np.zeros(0)
    bodies = (*reference_bodies(robot), reference_body(payload))
    # The payload's own columns are those of a body.
    lower, upper = coefficient_bounds(regressor.robot, fit.effects[1:], regressor.names[first + 10 :])
    chosen = selection(fit.base)
    program = Program(chosen, fit.theta, bodies, (None,) * len(bodies), lower, upper)
    nearest = nearest_unconstrained(program)
    if is_possible(program, nearest):
        return nearest
    root = covariance_root(fit)
    return solve_program(replace(program, factor=root @ chosen, target=root @ fit.theta)).pi


def _expected(fit: Fit, first: int) -> Array:
    """A ball of the mass and centre that the fit tells, 1 kg in the origin where it tells none."""
    row_of = {k: row for row, (k, name) in enumerate(zip(fit.base.independent, fit.names, strict=True))
            if not name.endswith("R")}  # fmt: skip
    row = row_of.get(first)
    if row is None or not fit.theta[row] > max(_SLIGHT, 2 * fit.std()[row]):
        return body_parameters(1.0, np.zeros(3), _RADIUS**2 * np.eye(3))
    mass = float(fit.theta[row])
    moments = [fit.theta[row_of[first + axis]] if first + axis in row_of else 0.0 for axis in (1, 2, 3)]
    return body_parameters(mass, np.array(moments) / mass, mass * _RADIUS**2 * np.eye(3))


def _pose(robot: Robot) -> Array:
    """The frame that is stated in that of the joint which moves it; where none is stated, that of the joint itself."""
    if robot.payload_frame is None:
        return np.eye(4)
    return robot.model.frames[robot.model.getFrameId(robot.payload_frame)].placement.homogeneous
