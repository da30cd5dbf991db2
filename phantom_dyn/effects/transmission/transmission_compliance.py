"""A transmission that gives way: ``tl = k (q_motor - q_link)``, with the torque ``tl`` that it passes to the link.

The link is not where a motor-side encoder says. It swings on the spring, driven by the torque that it would need to
follow its motor: the amplitude is found by integrating that swing, which takes no derivative of a torque. It leaves a
torque on every joint that feels the link, with an anti-resonance whose frequency does not depend on amplitude (that
of backlash does). Well below it, it looks like a delay or a rotor inertia; content near it, or an encoder on the link,
separates them. Friction and rotor are taken to sit on the motor's side.
MJCF: a second joint on the same axis with ``stiffness``, the rotor as the first one's ``armature``; URDF has no place
for it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    Transmission,
    row_of,
    stiffness_unit,
)
from phantom_dyn.effects.simulated import SPRING_DAMPING, SWING_DAMPING
from phantom_dyn.effects.support.displaced import behind_encoder, change_by_link, exact_change_by_link, load_and_inertia
from phantom_dyn.effects.support.encoder_lattice import stated_step
from phantom_dyn.effects.support.rows import branch_rows
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.spectra import power_density

# Frequencies [Hz] at which the link swings on its spring that are tried; above the last one nothing but the size of
# the effect depends on the stiffness in the band of a recording. Soft springs swing within the band, where a frequency
# that is a quarter off no longer fits.
_SWINGS = np.array([70.0, 35.0, 22.0, 14.0, 9.0])
_SOFT_SWINGS = np.array([7.2, 5.7, 4.5, 3.6, 2.9, 2.3, 1.8, 1.45])
# A frequency may be off by half the way to the next one: so far may a coefficient be off its shape, in squares.
_SPREAD = 2.5
# Compliances that are tried about one that was found, as shares of it.
_NEARBY = (0.75, 0.9, 1.0, 1.11, 1.33)
# Damping ratio of a swing below so many hertz, which is seen to ring.
_SOFT, _DAMPING_OF_SOFT = 8.0, 0.04
# A recording that begins in motion (share of a joint's top speed) does not show how the spring is bent at the start:
# swings in which that fades, the last one less and less, and the damping ratio meanwhile.
_MOVING, _FADING, _FADE = 0.05, 3.0, 0.5
# Ratios between which it is tried about one that was found, and the shares of it.
_DAMPING_RANGE = (0.005, 0.3)
_NEARBY_DAMPING = (0.4, 0.7, 1.4, 2.5)
# The load is followed up to an edge [Hz]: where the noise of the stated encoder has half its amplitude, within the
# first and third number; the second where no step is stated.
Edges = tuple[float, float, float]
_EDGES: Edges = (8.0, 12.0, np.inf)
# Frequency [Hz] below which nobody would take a transmission for rigid.
_SLOWEST = 1.0
# Smallest compliance [rad/(N m) or m/N]: a stiffer transmission is rigid.
_LEAST = 1e-10


class TransmissionCompliance(Effect):
    """Spring between motor and link of one joint. The coefficient is the compliance ``1/k``."""

    name = "transmission_compliance"
    regime = "high_acceleration"
    made_of = ("acceleration", "model")
    fitted = "secant"
    words = EffectWords(
        name="transmission compliance",
        meaning="the transmission gives like a spring between motor and link",
        next_step="Compare the stiffness with the data sheet of gear, belt or cable, and model the joint as elastic.",
        size="with a stiffness of {stiffness}",
        parameters={"stiffness": "torque per deflection between motor and link"},
        shown_over=("torque_curvature", "torque_rate", "transmitted"),
        separated_by="link encoder",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``stiffness`` k."""
        least = link_inertia(robot, row_of(robot, joint)) * (2.0 * np.pi * _SLOWEST) ** 2
        return (
            Parameter(
                "stiffness",
                stiffness_unit(robot, joint),
                0.0,
                above_zero=True,
                plausible=(least, np.inf),
                plausible_because="a link that swings less than once a second on its transmission is seen to hang",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Compliances at which the link swings at some frequencies, from stiff to soft, each with a damping ratio."""
        inertia = float(np.median(load_and_inertia(operation, row_of(robot, joint))[1]))
        tried = (float(inertia * (2.0 * np.pi * f) ** 2) for f in (*_SWINGS, *_SOFT_SWINGS))
        return tuple((1.0 / stiffness, usual_damping(stiffness, inertia)) for stiffness in tried)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """Shapes near the last one, and the last estimate; near a resonance that fits its height, not its frequency."""
        compliance, damping = shape
        least, most = _DAMPING_RANGE
        dampings = (share * damping for share in _NEARBY_DAMPING)
        return (
            *((factor * compliance, damping) for factor in _NEARBY),
            *((compliance, other) for other in dampings if least <= other <= most),
            self.at_estimate(coefficients, shape),
        )

    def at_estimate(self, coefficients: Array, shape: Shape) -> Shape:
        """The coefficient, with the same damping ratio."""
        return (max(float(coefficients[0]), _LEAST), shape[1])

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Additional drive torque per unit of compliance, as a secant from zero to that of ``shape``."""
        row = row_of(robot, joint)
        compliance, damping = shape
        change = change_by_link(operation, row, *swing(operation, row, 1.0 / compliance, damping)) / compliance
        unit = self.probe_unit(robot, joint, "compliance")
        rows = branch_rows(robot, joint)
        return Signature(rows, change[:, list(rows), None], ("compliance",), (unit,))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds near the shape, which sets the frequency of the swing."""
        return ((shape[0] / _SPREAD, shape[0] * _SPREAD),)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """``k`` is one over the compliance."""
        return np.array([1.0 / max(float(coefficients[0]), _LEAST)])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """One unit of compliance: an undetected compliance is below a limit, its stiffness above one."""
        return "compliance", np.array([1.0])

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of a compliance: one over that of a stiffness."""
        return "m/N" if robot.prismatic[row_of(robot, joint)] else "rad/(N m)"

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """Stiffness that belongs to a compliance."""
        return (1.0 / size,) if size > 0 else None

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """It cannot be seen if the encoder sits on the link's side."""
        return behind_encoder(robot, row_of(robot, joint))

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Torque of the links as read less that of the links where they truly are."""
        row = row_of(robot, joint)
        return -exact_change_by_link(robot, operation, row, *swing(operation, row, theta.item()))

    def link_ahead(self, operation: Operation, joint: str | None, theta: Array) -> Array:
        """How far the link swings ahead."""
        out = np.zeros_like(operation.q)
        row = row_of(operation.robot, joint)
        out[:, row] = swing(operation, row, theta.item())[0]
        return out

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A spring without play, and a little damping."""
        row = row_of(robot, joint)
        damping = 2.0 * SPRING_DAMPING * np.sqrt(theta.item() * moving_mass(robot, row))
        return Simulated(transmission=Transmission(robot.joint_names[row], theta.item(), float(damping), 0.0))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """Model files can contain all of it, as this number."""
        return ModelNumbers(whole=True, stiffness=theta.item())


def moving_mass(robot: Robot, row: int) -> float:
    """Inertia with which rotor and link of a joint swing against each other, links stretched out to zero positions."""
    rotor, link = float(robot.rotor_inertia[row]), link_inertia(robot, row)
    return rotor * link / (rotor + link)


def link_inertia(robot: Robot, row: int) -> float:
    """Inertia of all that a joint moves besides its rotor, links stretched out to zero positions."""
    return float(mass_matrix(robot, np.zeros((1, robot.nv)))[0, row, row]) - float(robot.rotor_inertia[row])


def usual_damping(stiffness: float, inertia: float) -> float:
    """Damping ratio of a link that swings on a spring, where nothing is known of it: soft springs ring for longer."""
    return _DAMPING_OF_SOFT if stiffness < inertia * (2.0 * np.pi * _SOFT) ** 2 else SWING_DAMPING


def swing(operation: Operation, row: int, stiffness: float, damping: float | None = None) -> tuple[Array, Array, Array]:
    r"""How far the link of a joint is ahead of its motor, and its first two time derivatives, each of shape ``(N,)``.

    :math:`m\,\ddot\delta + (d + c)\,\dot\delta + (k + g)\,\delta = -t_l`, with the torque :math:`t_l` that the link
    would need to follow its motor and the derivatives :math:`m, c, g` of that torque; by the trapezoidal rule, which
    no stiffness makes unstable, from where the spring is in balance. Where the robot moves at the start, the first
    swings are damped more, so that a spring that is not in balance there is forgotten.

    Args:
        operation: Motion and torque.
        row: Row of the joint.
        stiffness: Of the spring [N m/rad or N/m].
        damping: Ratio of the damping to the critical one of the link on its spring; None: the usual one.
    """
    load, inertia = followed_load(operation, row, _EDGES)
    if damping is None:
        damping = usual_damping(stiffness, float(np.median(inertia)))
    to_q, to_v = (part[:, row, row] for part in operation.partials[:2])
    pull = -load / inertia
    spring = np.maximum(stiffness + to_q, 0.1 * stiffness) / inertia
    ratio = np.full(len(operation.t), damping)
    if np.any(np.abs(operation.v[0]) > _MOVING * np.abs(operation.v).max(axis=0)):
        swings = (operation.t - operation.t[0]) * np.sqrt(stiffness / np.median(inertia)) / (2.0 * np.pi)
        ratio += np.clip(_FADING - swings, 0.0, 1.0) * max(_FADE - damping, 0.0)
    drag = np.maximum(2.0 * ratio * np.sqrt(stiffness * inertia) + to_v, 0.0) / inertia
    place, speed, gain = swing_steps(0.5 * np.diff(operation.t), pull, spring, drag)
    return place, speed, gain


def followed_load(operation: Operation, row: int, edges: Edges) -> tuple[Array, Array]:
    """Torque that a transmission passes, without frequencies where encoder rounding covers it, and the link's inertia.

    Args:
        operation: Motion and torque.
        row: Row of the joint.
        edges: Frequencies [Hz] between which the load ends, the second one where no step of the encoder is stated.

    Returns:
        Load [N m or N] and inertia [kg m^2 or kg], shape ``(N,)`` each.
    """
    key = ("followed_load", row, edges)
    load, inertia = load_and_inertia(operation, row)
    if key not in operation.kept:
        edge = _edge(operation.t, load, float(np.median(inertia)), stated_step(operation.robot, row), edges)
        operation.kept[key] = _followed(operation.t, load, edge)
    return operation.kept[key], inertia


def swing_steps(half: Array, pull: Array, spring: Array, drag: Array) -> Array:
    """Position, speed and acceleration of a damped mass on a spring under a given force, at all samples.

    Args:
        half: Half the time between samples [s], ``(N - 1,)``.
        pull: Acceleration by the load, ``(N,)``.
        spring: Acceleration back per unit of place, ``(N,)``.
        drag: Acceleration back per unit of speed, ``(N,)``.
    """
    out = np.zeros((3, len(pull)))
    swing_loop(half, pull, spring, drag, out)
    return out


@jit
def swing_loop(half: Array, pull: Array, spring: Array, drag: Array, out: Array) -> None:
    """As `swing_steps`, into an array of zeros: compiling an allocation takes longer than the rest."""
    out[0, 0] = pull[0] / spring[0]
    place, speed, gain = out[0, 0], 0.0, 0.0
    for k in range(1, len(pull)):
        h = half[k - 1]
        # Place and speed of the next sample are those without its acceleration, plus h^2 and h times it.
        ahead, faster = place + h * (2.0 * speed + h * gain), speed + h * gain
        gain = (pull[k] - drag[k] * faster - spring[k] * ahead) / (1.0 + h * (drag[k] + h * spring[k]))
        place, speed = ahead + h * h * gain, faster + h * gain
        out[0, k], out[1, k], out[2, k] = place, speed, gain


def _edge(t: Array, load: Array, inertia: float, step: float | None, edges: Edges) -> float:
    """Frequency [Hz] up to which ``load`` is more than what the rounding of an encoder to ``step`` makes of it."""
    if step is None or len(t) < 16:
        return edges[1]
    rate = (len(t) - 1) / float(t[-1] - t[0])
    f, power = power_density(load, rate, min(len(t), int(2.0 * rate)))
    noise = (inertia * step * (2.0 * np.pi * f) ** 2) ** 2 / (6.0 * rate)
    lost = np.flatnonzero((power < 4.0 * noise) & (f > edges[0]))
    return edges[2] if len(lost) == 0 else min(float(f[lost[0]]), edges[2])


def _followed(t: Array, load: Array, edge: float) -> Array:
    """``load`` without what lies above ``edge`` [Hz], without delay."""
    if len(t) < 16:
        return load
    rate = (len(t) - 1) / float(t[-1] - t[0])
    if edge > 0.4 * rate:
        return load
    return low_passed(load, edge, rate, order=2, padding=int(3 * rate / edge))
