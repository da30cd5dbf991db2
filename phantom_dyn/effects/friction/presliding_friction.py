"""Friction of a bristle: a spring of stiffness ``torque / displacement`` that slips once it has given ``torque``.

With ``z`` the bristle's deflection, ``z += dq`` held within ``+-displacement``, the torque is ``-T z/displacement``.
It leaves a torque that grows with the way since the last reversal, whatever the speed, up to Coulomb friction, which
it contains (no displacement). It is confused with Coulomb friction and a late drive, and with backlash: reversals at
several accelerations separate them, as the curves overlay over displacement here and over time for a late drive.

The Coulomb friction of a model is a step at each reversal; that of a robot builds up, all of it. So the bristle may
take the place of modelled friction: ``coulomb_torque``, at most zero, is the change of what sets in at once.

With two more numbers, ``static_ratio`` and ``stick_velocity``, it is the modified Karnopp friction of simulated haptic
hardware: it slips with ``T``, sticks below the stick velocity to where it was the sample before, by a spring of
stiffness ``static_ratio T / displacement``, and breaks loose at ``static_ratio T``.
URDF: ``<dynamics friction>``, MJCF: ``frictionloss``, for the torque behind the bristle only.
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

# Keeps the law defined where a fit goes to Coulomb friction [rad or m].
_LEAST_DISPLACEMENT = 1e-12
# Displacement [rad, m] after which every contact slips.
_LONGEST, _LONGEST_LINEAR = 0.2, 0.01
# No position yet; no deflection (or: not stuck, no anchor).
_NEW = np.array([np.nan, 0.0, 0.0])


def dahl(q: Float[Array, " N"], displacement: float) -> Float[Array, " N"]:
    r"""Torque of a Dahl (1968) bristle as a share of its largest, along the positions ``q``; 0 at the first sample.

    :math:`dz/dq = (1 - z\,\mathrm{sign}\,dq) / d`, solved exactly from sample to sample. Each step is ``z -> r z + c``;
    two of them one after the other are again one, so that all are put together in ``log2(N)`` passes.

    Args:
        q: Positions [rad or m].
        displacement: d, over which it builds up from rest.
    """
    moved = np.diff(q, prepend=q[:1])
    ratio = np.exp(-np.abs(moved) / displacement)
    constant = np.sign(moved) * (1.0 - ratio)
    reach = 1
    while reach < len(q):
        constant = np.concatenate([constant[:reach], ratio[reach:] * constant[:-reach] + constant[reach:]])
        ratio = np.concatenate([ratio[:reach], ratio[reach:] * ratio[:-reach]])
        reach *= 2
    return constant


def yielding(operation: Operation, joint: str | None, own: Array, shape: Array) -> Float[Array, "N nv"]:
    """Torque of a Dahl bristle, which yields gradually and does not slip at once; the same words describe it."""
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
    other_laws = (yielding,)
    words = EffectWords(
        name="presliding friction",
        meaning="friction that builds up over a small displacement after each reversal, like a spring that lets go",
        next_step="Record reversals at three or more accelerations, then use a bristle model in the simulation.",
        size="of {torque}, built up over {displacement}",
        parameters={
            "torque": "friction torque once the joint slides",
            "displacement": "way after a reversal over which friction builds up",
            "coulomb_torque": "change of the Coulomb torque that sets in at once",
            "static_ratio": "friction torque at rest over that while sliding",
            "stick_velocity": "speed below which the joint sticks",
        },
        shown_over=("displacement",),
        kept="of presliding friction, the torque behind the bristle",
        lost="the way of presliding friction up to its torque",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Torque in full slip, the displacement at which the bristle slips, and what it leaves of modelled friction."""
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
        left = Parameter(
            "coulomb_torque",
            torque_unit(robot, joint),
            -modelled,
            0.0,
            default=0.0,
            plausible=(-modelled, 0.0),
            plausible_because="the bristle takes the place of no more friction than is modelled",
        )
        return (*own, left)

    def optional_parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Static ratio and stick velocity, with which the joint sticks."""
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
        """Displacements from 0.4 % to 40 % of the way between reversals: shorter is Coulomb, longer is a spring."""
        way = max(float(np.percentile(strokes(operation, row_of(robot, joint)), 95)), 1e-9)
        return tuple((float(x),) for x in np.geomspace(0.004, 0.4, 6) * way)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same displacement, and a quarter less and a third more."""
        return tuple((factor * shape[0],) for factor in (0.75, 1.0, 4 / 3))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Share of the slip torque that the bristle gives at displacement ``shape``, and the direction of motion."""
        row, unit = row_of(robot, joint), torque_unit(robot, joint)
        columns = {"torque": (bristle(operation.q[:, row], shape[0]), unit)}
        if modelled_friction_of(robot, joint)[1] > 0.0:
            columns["coulomb_torque"] = (np.sign(operation.v[:, row]), unit)
        return on_one_joint(robot, joint, **columns)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """A bristle holds back, and takes the place of no more Coulomb friction than is modelled."""
        modelled = modelled_friction_of(robot, joint)[1]
        return ((0.0, np.inf), (-modelled, 0.0)) if modelled > 0.0 else ((0.0, np.inf),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Without a displacement, or without a torque, it is Coulomb friction.

        It builds up during the time that a joint needs for the displacement, which is proportional to the root of the
        displacement at a constant acceleration. Where it is short, recordings show its product with the torque, and
        neither of the two.
        """
        less = coefficients[0] * np.sqrt(np.array(shape))
        total = np.sum(coefficients, keepdims=True)
        return SpecialCase((), np.concatenate([total, less])), SpecialCase(("coulomb_friction",), less)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The slip torque, the displacement of the shape, and the change of the modelled Coulomb torque."""
        return np.array([coefficients[0], shape[0], *coefficients[1:]])

    def remark(self, robot: Robot, joint: str | None, theta: Array) -> str:
        """A sentence on the modelled friction whose place it takes, if there is any."""
        unit, coulomb = torque_unit(robot, joint), _bristle_and_coulomb(theta)[1]
        if coulomb == 0.0:
            return ""
        modelled = modelled_friction_of(robot, joint)[1]
        return (
            f"Of the {modelled:.3g} {unit} of Coulomb friction that the model has on {joint}, {-coulomb:.2g} {unit} do "
            "not set in at once: they are part of its presliding friction."
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Torque of the bristle, beside all friction that is modelled."""
        return "torque", np.array([1.0, 0.0] if modelled_friction_of(robot, joint)[1] > 0.0 else [1.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """It cannot be seen without a reversal: the bristle stays deflected."""
        return never_reverses(robot, operation, joint)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The law along the motion; the bristle starts at rest.

        ``theta`` may lack the change of the Coulomb torque, and may have the two numbers of sticking at its end.
        """
        row = row_of(robot, joint)
        q, v = operation.q[:, row], operation.v[:, row]
        own, coulomb = _bristle_and_coulomb(theta)
        step = -coulomb * np.sign(v)
        if len(own) == 2:
            return torque_on_joint(robot, joint, step - own[0] * bristle(q, own[1]))
        values, state = np.empty(len(q)), _NEW
        for k in range(len(q)):
            state, values[k] = stick_step(state, q[k], v[k], own)
        return torque_on_joint(robot, joint, step + values)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The same, one step after the other: the state is the last position and what the bristle remembers."""
        own, coulomb = _bristle_and_coulomb(theta)
        function = bristle_law if len(own) == 2 else stick_law
        law = Law(function, row_of(robot, joint), tuple(map(float, own)), tuple(map(float, _NEW)))
        changed = None if coulomb == 0.0 else lambda moved: with_friction(moved, joint, coulomb=coulomb)
        return Simulated(_NEW, robot=changed, laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The torque behind the bristle, less the modelled friction whose place it takes."""
        return ModelNumbers(coulomb=float(theta[0] + _bristle_and_coulomb(theta)[1]))


def _bristle_and_coulomb(theta: Array) -> tuple[Array, float]:
    """Numbers of the bristle, and the change of the modelled Coulomb torque, which only three or five numbers have."""
    return (np.delete(theta, 2), float(theta[2])) if len(theta) in (3, 5) else (theta, 0.0)


def strokes(operation: Operation, row: int) -> Float[Array, " n"]:
    """Ways between reversals of a joint [rad or m], the first and the last one included."""
    q = operation.q[:, row]
    return np.abs(np.diff(q[[0, *turning_points(operation, row), len(q) - 1]]))


def bristle(q: Float[Array, " N"], displacement: float) -> Float[Array, " N"]:
    """Deflection of the bristle over its largest one, -1 to 1, along the positions ``q``; 0 at the first."""
    out = np.zeros(len(q))
    _deflect(np.ascontiguousarray(q, dtype=float), displacement, out)
    return out


@jit
def _deflect(q: Array, displacement: float, out: Array) -> None:
    """Fill ``out`` with the deflection over the largest one: the torque of a bristle that pushes with one unit."""
    z, last = 0.0, np.nan
    for k in range(len(q)):
        z, out[k] = bristle_law(last, z, q[k], -1.0, displacement)
        last = q[k]


def stick_step(state: Float[Array, " 3"], q: float, v: float, theta: Array) -> tuple[Array, float]:
    """The next state and the torque of Karnopp friction; ``theta`` has static ratio and stick velocity too."""
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
    """Whether it sticks now (1 or 0), what to, and the torque of Karnopp friction.

    Args:
        last: Position at the sample before, NaN at the first.
        stuck: 1 if it stuck there.
        anchor: Position that it stuck to.
        q: Position now.
        v: Velocity now.
        torque: Friction in slip.
        displacement: Way over which the spring of the stuck state reaches ``ratio`` times ``torque``.
        ratio: Torque at which it breaks loose, over ``torque``.
        stick_velocity: It sticks below that speed.
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
    """Deflection of the bristle at position ``q`` and its torque; ``last`` and ``z`` are those of the step before."""
    d = max(displacement, _LEAST_DISPLACEMENT)
    # Comparisons and no isnan: what is not a number yet is nowhere.
    z = min(max(z + q - last, -d), d) if last == last else 0.0
    return z, -torque * z / d
