"""Friction that changes as the drive warms up: ``-((T + kT d) sign(v) + (c + kc d) v)`` with ``d = temp - temp0``.

Warm lubricants are thinner, so that viscous friction falls. Coulomb friction may fall too, as seals and preloads relax,
or it may grow, if heat tightens a bearing. If the slopes ``kT`` and ``kc`` are zero, the law is Coulomb and viscous
friction. A recording in which the drive warms up and cools down separates temperature from other causes that drift with
time.

The recording must have the temperature of the drive (column ``temp.<joint>``). The reference ``temp0`` is the mean
temperature of the recording, rounded to five degrees; there the friction is known best. Temperatures change over
minutes, so a simulation has one temperature: the mean of its recording, or the reference if none was recorded. URDF and
MJCF have a place for friction at the reference only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    FormulaTerm,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    SpecialCase,
    damping_unit,
    on_one_joint,
    row_of,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.described import less
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import (
    dry_range,
    modelled_friction_of,
    never_reverses,
    stated_limit,
    viscous_range,
)

# Range of temperatures in which drives with grease and magnets work [deg C].
_COLDEST, _HOTTEST = -60.0, 200.0
# Friction may change by at most the torque limit of the drive within this change of temperature [deg C]; this bounds
# the slope.
_LEAST_FULL_CHANGE = 10.0
# Smallest change of temperature [deg C] in a recording; steps of a sensor are a degree or half a degree.
_LEAST_CHANGE = 3.0
# The reference is a multiple of this [deg C], so that recordings at similar temperatures have the same reference.
_ROUNDED = 5.0


class TemperatureDependentFriction(Effect):
    """Friction of one joint that changes with the temperature of its drive."""

    name = "temperature_dependent_friction"
    regime = "time_drift"
    acts_as = "dry friction"
    fitted = "shape held"
    words = EffectWords(
        name="temperature-dependent friction",
        meaning="friction that changes as the drive warms up",
        next_step="Warm the joint up before it works or is measured, or compensate its friction by its temperature; a "
        "recording that warms up and cools down confirms it.",
        size="of {coulomb_torque} and {coefficient} at {reference_temperature}, with slopes of {torque_slope} and "
        "{coefficient_slope}",
        parameters={
            "coulomb_torque": "friction torque at any speed, at the reference temperature",
            "coefficient": "friction torque per unit of speed, at the reference temperature",
            "torque_slope": "change of that friction torque per degree",
            "coefficient_slope": "change of that coefficient per degree",
            "reference_temperature": "temperature at which the levels are stated",
        },
        shown_over=("velocity",),
        kept="of friction that depends on temperature, the levels at the reference temperature",
        lost="how friction changes with temperature",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Coulomb torque and viscous coefficient at the reference temperature, their slopes, and this temperature."""
        torque, damping = torque_unit(robot, joint), damping_unit(robot, joint)
        steepest = stated_limit(robot, joint) / _LEAST_FULL_CHANGE
        return (
            dry_range(robot, joint, "coulomb_torque"),
            viscous_range(robot, joint, "coefficient"),
            Parameter(
                "torque_slope",
                _per_degree(torque),
                default=0.0,
                plausible=(-steepest, steepest),
                plausible_because="friction does not change by all that the drive can give within ten degrees",
            ),
            Parameter(
                "coefficient_slope",
                _per_degree(damping),
                default=0.0,
                plausible=(-np.inf, np.inf),
                plausible_because="warm lubricant may thin by any amount, and a bearing that heat tightens may add any "
                "amount",
            ),
            Parameter(
                "reference_temperature",
                "°C",
                _COLDEST,
                _HOTTEST,
                default=25.0,
                plausible=(_COLDEST, _HOTTEST),
                plausible_because="grease sets below it, and magnets and windings fail above it",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """One shape: the reference temperature [deg C]."""
        mean = mean_temperature(operation, row_of(robot, joint))
        return ((25.0 if mean is None else float(_ROUNDED * np.round(mean / _ROUNDED)),),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Four columns: ``sign(v)`` and ``v``, then both times the temperature above the reference ``shape``."""
        row, torque, damping = row_of(robot, joint), torque_unit(robot, joint), damping_unit(robot, joint)
        v, warmer = operation.v[:, row], degrees_above(operation, row, shape[0])
        s = np.sign(v)
        return on_one_joint(
            robot,
            joint,
            coulomb_torque=(s, torque),
            coefficient=(v, damping),
            torque_slope=(s * warmer, _per_degree(torque)),
            coefficient_slope=(v * warmer, _per_degree(damping)),
        )

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The coefficients, then the reference temperature."""
        return np.array([*coefficients, *shape])

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bounds: minus the modelled friction at the reference temperature; slopes have no bounds."""
        viscous, coulomb = modelled_friction_of(robot, joint)
        return ((-coulomb, np.inf), (-viscous, np.inf), (-np.inf, np.inf), (-np.inf, np.inf))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Viscous friction alone, Coulomb friction alone, or both, without dependence on temperature."""
        return (
            SpecialCase(("coulomb_friction",), coefficients[[1, 2, 3]]),
            SpecialCase(("viscous_friction",), coefficients[[0, 2, 3]]),
            SpecialCase(("coulomb_friction", "viscous_friction"), coefficients[2:]),
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the slope of Coulomb friction, which no simpler law has."""
        return "torque_slope", np.array([0.0, 0.0, 1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the temperature was not recorded or hardly changes, or if the joint never reverses."""
        row = row_of(robot, joint)
        if mean_temperature(operation, row) is None:
            return f"the temperature of its drive was not recorded (column temp.{joint})"
        assert operation.temperature is not None
        change = float(np.ptp(np.percentile(operation.temperature[:, row], (2, 98))))
        if change < _LEAST_CHANGE:
            return f"the temperature of {joint} changes by {change:.2g} °C only, wanted {_LEAST_CHANGE:g} °C or more"
        return never_reverses(robot, operation, joint)

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """Two terms: ``sign(v)`` and ``v``, each times the temperature above the middle one."""
        kind, rest = "{} that changes with temperature", middle("temp")
        warmer = less("temp", rest)
        return (
            FormulaTerm(kind.format("friction"), f"{warmer}*sign(v)", lambda temp, v: (temp - rest) * np.sign(v), "°C"),
            FormulaTerm(kind.format("damping"), f"{warmer}*v", lambda temp, v: (temp - rest) * v, "°C {speed}"),
        )

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Friction on the joint, zero at rest; without a recorded temperature, at the reference temperature."""
        row = row_of(robot, joint)
        v, warmer = operation.v[:, row], degrees_above(operation, row, theta[4])
        law = -(theta[0] + theta[2] * warmer) * np.sign(v) - (theta[1] + theta[3] * warmer) * v
        return torque_on_joint(robot, joint, law)

    def at_work(self, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Friction at the mean temperature of the recording, with slopes of zero."""
        mean = mean_temperature(operation, row_of(operation.robot, joint))
        if mean is None:
            return theta
        coulomb, viscous = theta[:2] + theta[2:4] * (mean - theta[4])
        return np.array([coulomb, viscous, 0.0, 0.0, mean])

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with the friction at the reference temperature added; it sticks at rest."""
        coulomb, viscous = float(theta[0]), float(theta[1])
        return Simulated(robot=lambda moved: with_friction(moved, joint, viscous=viscous, coulomb=coulomb))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """Friction at the reference temperature."""
        return ModelNumbers(viscous=float(theta[1]), coulomb=float(theta[0]))


def mean_temperature(operation: Operation, row: int) -> float | None:
    """Mean temperature [deg C] of the drive of a joint; None if it was not recorded in all samples."""
    if operation.temperature is None or not np.isfinite(operation.temperature[:, row]).all():
        return None
    return float(operation.temperature[:, row].mean())


def degrees_above(operation: Operation, row: int, reference: float) -> Float[Array, " N"]:
    """Temperature of the drive of a joint minus a reference [deg C]; zero where it was not recorded."""
    if operation.temperature is None:
        return np.zeros(len(operation.t))
    return np.nan_to_num(operation.temperature[:, row] - reference, nan=0.0)


def _per_degree(unit: str) -> str:
    """Unit of a slope: the given unit per degree."""
    above, _, below = unit.partition("/")
    return f"{above}/({below} °C)" if below else f"{above}/°C"
