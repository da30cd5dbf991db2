"""Friction that changes as the drive warms up: ``-((T + kT d) sign(v) + (c + kc d) v)`` with ``d = temp - temp0``.

Lubricants thin as they warm, so that viscous friction falls, and Coulomb friction with it as seals and preloads give
way; heat that presses a bearing tighter lets it grow. Without slopes it is Coulomb and viscous friction. Temperature
and anything else that drifts with time are separated where the drive warms up and cools down in one recording.
It needs the temperature of the drive (column ``temp.<joint>``). The reference temp0 is the recording's mean, rounded to
five degrees, where the levels are known best. Temperatures change over minutes, so a simulation is at one temperature:
the mean of its recording, else the reference. URDF and MJCF have a place for the levels at the reference only.
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

# Temperatures that a drive with grease in its gear and magnets in its motor works at [deg C].
_COLDEST, _HOTTEST = -60.0, 200.0
# Degrees within which friction does not change by all that a drive can give.
_AT_LEAST = 10.0
# Change of temperature [deg C] that stands out from the steps of a sensor, which are a degree or half of one.
_LEAST_CHANGE = 3.0
# The reference is a multiple of it, so that recordings at about one temperature have the same.
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
        """Levels at the reference temperature, their slopes, and that temperature."""
        torque, damping = torque_unit(robot, joint), damping_unit(robot, joint)
        steepest = stated_limit(robot, joint) / _AT_LEAST
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
                plausible_because="lubricants thin as they warm, cold grease by any amount, and tight bearings jam",
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
        """The reference: the mean temperature, rounded."""
        mean = mean_temperature(operation, row_of(robot, joint))
        return ((25.0 if mean is None else float(_ROUNDED * np.round(mean / _ROUNDED)),),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Direction of motion and velocity, and both times the temperature above that of the ``shape``."""
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
        """Levels and slopes as they are, and the reference."""
        return np.array([*coefficients, *shape])

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Friction holds back at the reference, together with what is modelled; it may fall or grow."""
        viscous, coulomb = modelled_friction_of(robot, joint)
        return ((-coulomb, np.inf), (-viscous, np.inf), (-np.inf, np.inf), (-np.inf, np.inf))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Without slopes it is plain friction."""
        return (
            SpecialCase(("coulomb_friction",), coefficients[[1, 2, 3]]),
            SpecialCase(("viscous_friction",), coefficients[[0, 2, 3]]),
            SpecialCase(("coulomb_friction", "viscous_friction"), coefficients[2:]),
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The slope of Coulomb friction, which no simpler law explains."""
        return "torque_slope", np.array([0.0, 0.0, 1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """It needs temperatures that change, and a reversal."""
        row = row_of(robot, joint)
        if mean_temperature(operation, row) is None:
            return f"the temperature of its drive was not recorded (column temp.{joint})"
        assert operation.temperature is not None
        change = float(np.ptp(np.percentile(operation.temperature[:, row], (2, 98))))
        if change < _LEAST_CHANGE:
            return f"the temperature of {joint} changes by {change:.2g} °C only, wanted {_LEAST_CHANGE:g} °C or more"
        return never_reverses(robot, operation, joint)

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """Direction and speed of motion, times the temperature."""
        kind, rest = "{} that changes with temperature", middle("temp")
        warmer = less("temp", rest)
        return (
            FormulaTerm(kind.format("friction"), f"{warmer}*sign(v)", lambda temp, v: (temp - rest) * np.sign(v), "°C"),
            FormulaTerm(kind.format("damping"), f"{warmer}*v", lambda temp, v: (temp - rest) * v, "°C {speed}"),
        )

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The law on the joint, zero at rest; at the reference where no temperature is known."""
        row = row_of(robot, joint)
        v, warmer = operation.v[:, row], degrees_above(operation, row, theta[4])
        law = -(theta[0] + theta[2] * warmer) * np.sign(v) - (theta[1] + theta[3] * warmer) * v
        return torque_on_joint(robot, joint, law)

    def at_work(self, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The levels at the mean temperature, without slopes."""
        mean = mean_temperature(operation, row_of(operation.robot, joint))
        if mean is None:
            return theta
        coulomb, viscous = theta[:2] + theta[2:4] * (mean - theta[4])
        return np.array([coulomb, viscous, 0.0, 0.0, mean])

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """More modelled friction, as it is at the reference temperature; it sticks at rest."""
        coulomb, viscous = float(theta[0]), float(theta[1])
        return Simulated(robot=lambda moved: with_friction(moved, joint, viscous=viscous, coulomb=coulomb))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The levels at the reference temperature."""
        return ModelNumbers(viscous=float(theta[1]), coulomb=float(theta[0]))


def mean_temperature(operation: Operation, row: int) -> float | None:
    """Mean temperature [deg C] of the drive of a joint; None where it was not recorded throughout."""
    if operation.temperature is None or not np.isfinite(operation.temperature[:, row]).all():
        return None
    return float(operation.temperature[:, row].mean())


def degrees_above(operation: Operation, row: int, reference: float) -> Float[Array, " N"]:
    """Temperature [deg C] of the drive of a joint above a reference; zero where it was not recorded."""
    if operation.temperature is None:
        return np.zeros(len(operation.t))
    return np.nan_to_num(operation.temperature[:, row] - reference, nan=0.0)


def _per_degree(unit: str) -> str:
    """A unit over a degree."""
    above, _, below = unit.partition("/")
    return f"{above}/({below} °C)" if below else f"{above}/°C"
