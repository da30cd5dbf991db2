"""The linear equations between torque and unknown parameters, which estimators solve; computed block by block.

The unknowns are the standard inertial parameters (absolute values) and the coefficients of each effect. Shape
parameters of effects, such as a Stribeck velocity, are constant, so that the torque is linear in the unknowns. The rows
are the torques of every joint at every valid sample, low-passed to the band of the log. The columns are filtered like
the torque: filtering the torque alone changes the estimated friction by one per cent or more.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from identification.data.log import Log
from identification.regression.equation_blocks import BandedEffect, banded, blocks_of, touched_columns
from identification.regression.reduction import Reduction, reduce_blocks
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction, rotor_torque
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

EffectOnJoint = tuple[Effect, str | None] | tuple[Effect, str | None, Shape | float]
"""An effect, its joint (None for the whole robot) and, if the torque is not linear in all parameters, its shape.

A shape with a single number may be given as a float.
"""

WHOLE_LIMIT = 20_000_000
"""Largest number of entries of a regressor that is kept in memory (160 MB); a larger one is recomputed in each pass."""

_EFFECTS_LIMIT = 2_000_000  # largest number of entries in columns of effects that are kept (16 MB)

_FEW_SAMPLES = 8  # number of samples with which the columns of an effect are counted

_BLOCK = 1024  # samples at the full rate per block: 1024 x 6 joints x 80 columns are 4 MB


@dataclass(frozen=True)
class RegressorTerm:
    """An effect on a joint, with constant shape parameters (empty if the torque is linear in all parameters)."""

    effect: Effect
    joint: str | None
    shape: Shape

    @property
    def label(self) -> str:
        """Beginning of the names of its coefficients: ``joint.effect``, or the effect alone for the whole robot."""
        return self.effect.name if self.joint is None else f"{self.joint}.{self.effect.name}"


def term_of(robot: Robot, operation: Operation, given: EffectOnJoint) -> RegressorTerm:
    """The term of an effect.

    Args:
        robot: The model.
        operation: Motion and torque of a recording, which limit the possible shapes.
        given: The effect with its joint, and its shape if necessary.

    Raises:
        ParameterError: If the effect is nonlinear in a parameter and no shape is given for it.
    """
    effect, joint = given[0], given[1]
    if len(given) == 3:
        shape = given[2] if isinstance(given[2], tuple) else (float(given[2]),)
        return RegressorTerm(effect, joint, shape)
    shapes = effect.shapes(robot, operation, joint)
    if len(shapes) != 1:
        example = f", for instance ({', '.join(f'{x:.3g}' for x in shapes[len(shapes) // 2])},)" if shapes else ""
        raise ParameterError(
            f"{effect.name} is not linear in one of its parameters: give its shape as the third entry, "
            f"(effect, joint, shape){example}."
        )
    return RegressorTerm(effect, joint, shapes[0])


@dataclass(frozen=True)
class Regressor:
    r"""The equations :math:`W \theta = y` of a robot, its logs and effects.

    Attributes:
        robot: The robot with its rigid bodies.
        logs: Recordings, ready for fitting.
        terms: Effects with their joints and shapes.
        rigid_body: True if inertial parameters are unknowns; False if the torque of the given model is subtracted.
        names: Names of the columns: ``<body>.m`` and so on, then ``<joint>.<effect>.<coefficient>``.
        units: Units of the columns.
        touched: For each joint, the columns on which its torque can depend, ascending; others are zero in its rows.
    """

    robot: Robot
    logs: tuple[Log, ...]
    terms: tuple[RegressorTerm, ...]
    rigid_body: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    touched: tuple[tuple[int, ...], ...]

    @cached_property
    def count(self) -> int:
        """Number ``N`` of valid samples over all logs, at the reduced rate of the band."""
        return self.starts[-1]

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """Index of the first sample of each log, and last ``N``."""
        return tuple(accumulate((int(log.valid_in_band.sum()) for log in self.logs), initial=0))

    @property
    def first_effect(self) -> int:
        """Index of the first column of an effect; the columns before it are those of inertial parameters."""
        return 10 * (self.robot.model.njoints - 1) if self.rigid_body else 0

    @cached_property
    def W(self) -> Float[Array, "N nv p"]:
        """The whole regressor, shape ``(N, nv, p)``.

        Raises:
            ParameterError: If it has more than `WHOLE_LIMIT` entries.
        """
        if self.count * self.robot.nv * len(self.names) > WHOLE_LIMIT:
            raise ParameterError(
                f"The whole regressor of {self.count} samples would have more than {WHOLE_LIMIT} entries: "
                "go through blocks() instead."
            )
        return np.concatenate([np.zeros((0, self.robot.nv, len(self.names))), *self._computed_blocks()])

    @cached_property
    def y(self) -> Float[Array, "N nv"]:
        """Right-hand side [N m or N], shape ``(N, nv)``: measured torque minus `known_torque`."""
        return self.measured - np.concatenate(
            [self.in_band(log, known_torque(self.robot, log.motion, rigid_body=self.rigid_body)) for log in self.logs]
        )

    @cached_property
    def measured(self) -> Float[Array, "N nv"]:
        """Measured torque in the band, shape ``(N, nv)``."""
        return np.concatenate([self.in_band(log, log.tau) for log in self.logs])

    @staticmethod
    def in_band(log: Log, values: Float[Array, "M ..."]) -> Float[Array, "n ..."]:
        """Filter and decimate ``values``, which have the full rate of a log, and keep the valid samples only."""
        return log.band(values)[log.valid_in_band]

    @cached_property
    def reduction(self) -> Reduction:
        """Triangular factors of all equations."""
        return reduce_blocks(self.names, self.units, self.robot.joint_names, self.touched, self._with_torque())

    def blocks(self, columns: Sequence[int] | None = None) -> Iterator[Float[Array, "n nv p"]]:
        """Blocks of the regressor in the order of the samples, each ``(n, nv, p)`` and of one log.

        The blocks are slices of `W` if `W` has been computed, which is faster for many passes. Otherwise they are
        computed again.

        Args:
            columns: Columns to compute, ascending; by default all.
        """
        if "W" in self.__dict__:
            for start, stop in pairwise(self.starts):
                for k in range(start, stop, _BLOCK):
                    block = self.W[k : min(k + _BLOCK, stop)]
                    yield block if columns is None else block[:, :, list(columns)]
        else:
            yield from self._computed_blocks(columns)

    def _with_torque(self) -> Iterator[tuple[Float[Array, "n nv p"], Float[Array, "n nv"]]]:
        """Blocks of the regressor, each with the right-hand side of its samples."""
        start = 0
        for block in self.blocks():
            yield block, self.y[start : start + len(block)]
            start += len(block)

    def _computed_blocks(self, columns: Sequence[int] | None = None) -> Iterator[Float[Array, "n nv p"]]:
        """Blocks of the regressor, computed anew."""
        for log, effects in zip(self.logs, self._effects(), strict=True):
            yield from blocks_of(self.robot, log, effects, rigid_body=self.rigid_body, samples=_BLOCK, columns=columns)

    def _effects(self) -> Iterable[tuple[BandedEffect, ...]]:
        """Columns of the effects for each log; large ones are not kept in memory, but recomputed in each pass."""
        fits_in_memory = self.count * (len(self.names) - self.first_effect) <= _EFFECTS_LIMIT
        return self._kept_effects if fits_in_memory else map(self._effects_on, self.logs)

    @cached_property
    def _kept_effects(self) -> tuple[tuple[BandedEffect, ...], ...]:
        """Columns of the effects for each log."""
        return tuple(map(self._effects_on, self.logs))

    def _effects_on(self, log: Log) -> tuple[BandedEffect, ...]:
        """Columns of the effects for one log."""
        if not self.terms:
            return ()
        operation = Operation.of(self.robot, log.motion, log.tau, log.temperature)
        return banded(
            log, (term.effect.signature(self.robot, operation, term.joint, term.shape) for term in self.terms)
        )


def torque_regressor(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint] = ()) -> Regressor:
    """Equations whose unknowns are the standard inertial parameters and the coefficients of ``effects``.

    Armature and friction of the model are known; the effects are added to them.

    Args:
        robot: The robot with its rigid bodies.
        logs: One recording or several.
        effects: Effects that may act on the joints in addition to the rigid bodies.

    Raises:
        LogError: If a log has other joints than the robot, or no valid sample is left.
        ParameterError: If an effect is nonlinear in a parameter and no shape is given for it.
    """
    return _regressor(robot, logs, effects, rigid_body=True)


def gap_regressor(robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint]) -> Regressor:
    """Equations for the gap to the given model: its torque is subtracted, and only effects are unknown.

    Args:
        robot: The given model.
        logs: One recording or several.
        effects: Effects that the model may lack.

    Raises:
        LogError: If a log has other joints than the robot, or no valid sample is left.
        ParameterError: If an effect is nonlinear in a parameter and no shape is given for it.
    """
    return _regressor(robot, logs, effects, rigid_body=False)


def known_torque(robot: Robot, motion: Motion, *, rigid_body: bool) -> Float[Array, "N nv"]:
    """Drive torque that does not depend on the unknowns [N m or N], shape ``(N, nv)``.

    Args:
        robot: The model.
        motion: N samples.
        rigid_body: True if inertial parameters are unknown; then only armature and modelled friction are known.
    """
    if not rigid_body:
        return inverse_dynamics(robot, motion)
    return rotor_torque(robot, motion) + modelled_friction(robot, motion)


def _regressor(
    robot: Robot, logs: Log | Sequence[Log], effects: Sequence[EffectOnJoint], *, rigid_body: bool
) -> Regressor:
    """The equations, after a check of the logs."""
    several = (logs,) if isinstance(logs, Log) else tuple(logs)
    for log in several:
        if log.joint_names != robot.joint_names:
            raise LogError(
                f"{log.file} has the joints {', '.join(log.joint_names)} and the robot {', '.join(robot.joint_names)}: "
                "give the log of this robot."
            )
    if not any(log.valid_in_band.any() for log in several):
        raise LogError("No valid sample is left to fit: give a longer recording or exclude less of it.")
    log = next(log for log in several if log.valid_in_band.any())
    signatures = []
    if effects:
        operation = Operation.of(robot, log.motion, log.tau, log.temperature)
        few = Operation.of(robot, log.motion.at(slice(_FEW_SAMPLES)), log.tau[:_FEW_SAMPLES])
        terms = (term_of(robot, operation, given) for given in effects)
        signatures = [(term, term.effect.signature(robot, few, term.joint, term.shape)) for term in terms]
    effect_names = tuple(f"{term.label}.{name}" for term, signature in signatures for name in signature.names)
    effect_units = tuple(unit for _, signature in signatures for unit in signature.units)
    return Regressor(
        robot,
        several,
        tuple(term for term, _ in signatures),
        rigid_body,
        (parameter_names(robot) if rigid_body else ()) + effect_names,
        (parameter_units(robot) if rigid_body else ()) + effect_units,
        touched_columns(robot, [(s.rows, len(s.names)) for _, s in signatures], rigid_body=rigid_body),
    )


def term_columns(regressor: Regressor) -> tuple[tuple[int, ...], ...]:
    """Columns of each term, in the order of the terms.

    Args:
        regressor: Regressor, whose columns are in the order of its terms and have their labels in their names.
    """
    out, column = [], regressor.first_effect
    for term in regressor.terms:
        start = column
        while column < len(regressor.names) and regressor.names[column].startswith(f"{term.label}."):
            column += 1
        out.append(tuple(range(start, column)))
    return tuple(out)
