"""Friction of a bristle: a spring of stiffness ``torque / displacement`` that slips when its torque reaches ``torque``.

The deflection ``z`` of the bristle grows by ``dq`` and is clipped to ``+-displacement``; the torque is
``-T z/displacement``. So after each reversal the torque grows with the distance, at any speed, up to the Coulomb torque
``T``. Coulomb friction is the special case of a displacement of zero. The effect looks similar to backlash, and to
Coulomb friction together with a delay of the drive. Reversals at several accelerations separate them: the torque of a
bristle builds up over the same displacement, that of a delayed drive over the same time.

The Coulomb friction of a model jumps at each reversal, while the friction of a robot builds up. So the bristle may
replace modelled friction: ``coulomb_torque`` is the change of the modelled Coulomb torque, zero or negative.

With two more parameters, ``static_ratio`` and ``stick_velocity``, the effect is the modified Karnopp friction of
simulated haptic hardware. Below the stick velocity the joint sticks to the position of the sample before, by a spring
of stiffness ``static_ratio T / displacement``. It breaks loose at the torque ``static_ratio T`` and then slips with
``T``.
URDF: ``<dynamics friction>``, MJCF: ``frictionloss``, for the torque of the slipping bristle only.
"""

from __future__ import annotations

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
    SpecialCase,
    on_one_joint,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
    velocity_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import modelled_friction_of, never_reverses, stated_limit, turning_points

# Smallest displacement [rad or m]; it avoids a division by zero if a fit approaches Coulomb friction.
_LEAST_DISPLACEMENT = 1e-12
# Displacement after which every contact slips [rad, m].
_LONGEST, _LONGEST_LINEAR = 0.2, 0.01
# State at the start: no position yet, and no deflection (in `stick_law`: not stuck, no anchor).
_START = np.array([np.nan, 0.0, 0.0])


def dahl(q: Float[Array, " N"], displacement: float) -> Float[Array, " N"]:
    r"""Torque of a Dahl (1968) bristle as a share of its largest, along the positions ``q``; 0 at the first sample.

    :math:`dz/dq = (1 - z\,\mathrm{sign}\,dq) / d` is solved exactly from sample to sample.

    Args:
        q: Positions [rad or m].
        displacement: d, the displacement over which the torque builds up from rest.
    """
    moved = np.diff(q, prepend=q[:1])
    ratio = np.exp(-np.abs(moved) / displacement)
    out = np.sign(moved) * (1.0 - ratio)
    _accumulate(ratio, out)
    return out


@jit
def _accumulate(ratio: Array, out: Array) -> None:
    """Add to each entry of ``out`` its ratio times the entry before."""
    for k in range(1, len(out)):
        out[k] += ratio[k] * out[k - 1]


def dahl_torque(operation: Operation, joint: str | None, own: Array, shape: Array) -> Float[Array, "N nv"]:
    """Torque of a Dahl bristle, which starts to slip gradually; it has the same parameters as the effect."""
    out = np.zeros_like(operation.tau)
    row = row_of(operation.robot, joint)
    out[:, row] = own[0] * dahl(operation.q[:, row], float(shape[0]))
    if len(own) > 1:
        out[:, row] += own[1] * np.sign(operation.v[:, row])
    return out


class PreslidingFriction(Effect):
    """Friction of one joint that builds up over a displacement after each reversal."""

    name = "presliding_friction"
    regime = "velocity_reversal"
    acts_as = "dry friction"
    shows_with = "slow motion"
    other_laws = (dahl_torque,)
    words = EffectWords(
        name="presliding friction",
        meaning="friction that builds up over a small displacement after each reversal, like a spring that lets go",
        next_step="Record reversals at three or more accelerations, then use a bristle model in the simulation.",
        size="of {torque}, built up over {displacement}",
        parameters={
            "torque": "friction torque once the joint slides",
            "displacement": "displacement over which presliding friction builds up",
            "coulomb_torque": "change of the Coulomb torque that sets in at once",
            "static_ratio": "friction torque at rest over that while sliding",
            "stick_velocity": "speed below which the joint sticks",
        },
        shown_over=("displacement",),
        kept="of presliding friction, the torque behind the bristle",
        lost="the displacement over which presliding friction builds up",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Torque in slip, the displacement at which the bristle slips, and the change of the modelled friction."""
        row, modelled = row_of(robot, joint), modelled_friction_of(robot, joint)[1]
        own = (
            Parameter(
                "torque",
                torque_unit(robot, joint),
                0.0,
                plausible=(0.0, stated_limit(robot, joint)),
                plausible_because="a joint whose friction is more than its drive can give does not move",
            ),
            Parameter(
                "displacement",
                robot.position_units[row],
                0.0,
                plausible=(0.0, _LONGEST_LINEAR if robot.prismatic[row] else _LONGEST),
                plausible_because="contacts, seals and cables slip after a few degrees or millimetres",
            ),
        )
        if modelled == 0.0:
            return own
        change_of_coulomb = Parameter(
            "coulomb_torque",
            torque_unit(robot, joint),
            -modelled,
            0.0,
            default=0.0,
            plausible=(-modelled, 0.0),
            plausible_because="the bristle takes the place of no more friction than is modelled",
        )
        return (*own, change_of_coulomb)

    def optional_parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``static_ratio`` and ``stick_velocity`` of Karnopp friction."""
        return (
            Parameter(
                "static_ratio",
                "1",
                1.0,
                plausible=(1.0, 3.0),
                plausible_because="dry metals hold up to three times what they slip with",
            ),
            Parameter(
                "stick_velocity",
                velocity_unit(robot, joint),
                0.0,
                plausible=(0.0, 0.1),
                plausible_because="it stands for a standstill, and is below any working speed",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Displacements from 0.4 % to 40 % of the distance between reversals; a longer one would be a spring."""
        distance = max(float(np.percentile(strokes(operation, row_of(robot, joint)), 95)), 1e-9)
        return tuple((float(x),) for x in np.geomspace(0.004, 0.4, 6) * distance)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same displacement, one a quarter smaller and one a third larger."""
        return tuple((factor * shape[0],) for factor in (0.75, 1.0, 4 / 3))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns: relative deflection of a bristle; if Coulomb friction is modelled, also ``sign(v)``."""
        row, unit = row_of(robot, joint), torque_unit(robot, joint)
        columns = {"torque": (bristle(operation.q[:, row], shape[0]), unit)}
        if modelled_friction_of(robot, joint)[1] > 0.0:
            columns["coulomb_torque"] = (np.sign(operation.v[:, row]), unit)
        return on_one_joint(robot, joint, **columns)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds: the torque is not negative, and the bristle replaces at most the modelled Coulomb friction."""
        modelled = modelled_friction_of(robot, joint)[1]
        return ((0.0, np.inf), (-modelled, 0.0)) if modelled > 0.0 else ((0.0, np.inf),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No friction, and Coulomb friction, which has a displacement of zero.

        Friction builds up during the time that a joint needs for the displacement. At a constant acceleration this time
        is proportional to the square root of the displacement. If the time is short, a recording determines only the
        product of time and torque.
        """
        torque_root_displacement = coefficients[0] * np.sqrt(np.array(shape))
        change_of_coulomb = np.sum(coefficients, keepdims=True)
        no_friction = SpecialCase((), np.concatenate([change_of_coulomb, torque_root_displacement]))
        return no_friction, SpecialCase(("coulomb_friction",), torque_root_displacement)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The slip torque, the displacement of the shape, and the change of the modelled Coulomb torque."""
        return np.array([coefficients[0], shape[0], *coefficients[1:]])

    def remark(self, robot: Robot, joint: str | None, theta: Array) -> str:
        """A sentence on the modelled friction that the bristle replaces, if it does."""
        unit, coulomb = torque_unit(robot, joint), _bristle_and_coulomb(theta)[1]
        if coulomb == 0.0:
            return ""
        modelled = modelled_friction_of(robot, joint)[1]
        return (
            f"Of the {modelled:.3g} {unit} of Coulomb friction that the model has on {joint}, {-coulomb:.2g} {unit} do "
            "not set in at once: they are part of its presliding friction."
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: torque of the bristle."""
        return "torque", np.array([1.0, 0.0] if modelled_friction_of(robot, joint)[1] > 0.0 else [1.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the joint never reverses: the bristle then stays deflected."""
        return never_reverses(robot, operation, joint)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Friction along the motion; the bristle starts without deflection.

        ``theta`` may lack the change of the Coulomb torque, and may end with static ratio and stick velocity.
        """
        row = row_of(robot, joint)
        q, v = operation.q[:, row], operation.v[:, row]
        own, coulomb = _bristle_and_coulomb(theta)
        step = -coulomb * np.sign(v)
        if len(own) == 2:
            return torque_on_joint(robot, joint, step - own[0] * bristle(q, own[1]))
        values, state = np.empty(len(q)), _START
        for k in range(len(q)):
            state, values[k] = stick_step(state, q[k], v[k], own)
        return torque_on_joint(robot, joint, step + values)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A torque law; its memory is the last position, then the deflection, or whether and where the joint sticks."""
        own, coulomb = _bristle_and_coulomb(theta)
        function = bristle_law if len(own) == 2 else stick_law
        law = Law(function, row_of(robot, joint), tuple(map(float, own)), tuple(map(float, _START)))
        changed = None if coulomb == 0.0 else lambda moved: with_friction(moved, joint, coulomb=coulomb)
        return Simulated(_START, robot=changed, laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The torque in slip minus the modelled friction that the bristle replaces."""
        return ModelNumbers(coulomb=float(theta[0] + _bristle_and_coulomb(theta)[1]))


def _bristle_and_coulomb(theta: Array) -> tuple[Array, float]:
    """Parameters of the bristle, and the change of the modelled Coulomb torque (zero if ``theta`` has none)."""
    return (np.delete(theta, 2), float(theta[2])) if len(theta) in (3, 5) else (theta, 0.0)


def strokes(operation: Operation, row: int) -> Float[Array, " n"]:
    """Distances between reversals of a joint [rad or m], including those before the first and after the last one."""
    q = operation.q[:, row]
    return np.abs(np.diff(q[[0, *turning_points(operation, row), len(q) - 1]]))


def bristle(q: Float[Array, " N"], displacement: float) -> Float[Array, " N"]:
    """Deflection of the bristle as a share of its largest, -1 to 1, at positions ``q``; 0 at the first sample."""
    out = np.zeros(len(q))
    _deflect(np.ascontiguousarray(q, dtype=float), displacement, out)
    return out


@jit
def _deflect(q: Array, displacement: float, out: Array) -> None:
    """Write the deflection, as a share of the largest one, into ``out``."""
    z, last = 0.0, np.nan
    for k in range(len(q)):
        z, out[k] = bristle_law(last, z, q[k], -1.0, displacement)
        last = q[k]


def stick_step(state: Float[Array, " 3"], q: float, v: float, theta: Array) -> tuple[Array, float]:
    """The next state and the torque of Karnopp friction; ``theta`` includes static ratio and stick velocity."""
    stuck, anchor, torque = stick_law(state[0], state[1], state[2], q, v, theta[0], theta[1], theta[2], theta[3])
    return np.array([q, stuck, anchor]), torque


@torque_law
@jit
def stick_law(
    last: float,
    stuck: float,
    anchor: float,
    q: float,
    v: float,
    torque: float,
    displacement: float,
    ratio: float,
    stick_velocity: float,
) -> tuple[float, float, float]:
    """Whether the joint sticks now (1 or 0), the position that it sticks to, and the torque of Karnopp friction.

    Args:
        last: Position at the sample before, NaN at the first sample.
        stuck: 1 if the joint stuck at the sample before, otherwise 0.
        anchor: Position that it stuck to.
        q: Position now.
        v: Velocity now.
        torque: Friction torque in slip.
        displacement: Displacement at which the spring of a stuck joint reaches ``ratio`` times ``torque``.
        ratio: Torque at which the joint breaks loose, over ``torque``.
        stick_velocity: Speed below which the joint sticks.
    """
    if stuck == 0.0 and abs(v) < stick_velocity:
        stuck, anchor = 1.0, (q if np.isnan(last) else last)
    held = -ratio * torque * (q - anchor) / max(displacement, _LEAST_DISPLACEMENT)
    if stuck == 1.0 and abs(held) < ratio * torque:
        return 1.0, anchor, held
    return 0.0, anchor, -torque * np.sign(v)


@torque_law
@jit
def bristle_law(last: float, z: float, q: float, torque: float, displacement: float) -> tuple[float, float]:
    """Deflection of the bristle at ``q``, and its torque; ``last``, ``z``: position and deflection a step before."""
    d = max(displacement, _LEAST_DISPLACEMENT)
    # ``last`` is NaN at the first step, and only NaN differs from itself.
    z = min(max(z + q - last, -d), d) if last == last else 0.0
    return z, -torque * z / d
