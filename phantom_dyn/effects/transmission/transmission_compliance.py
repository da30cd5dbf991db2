"""An elastic transmission: ``tl = k (q_motor - q_link)``, with the torque ``tl`` that it passes to the link.

An encoder on the motor does not read the position of the link. The link swings on the spring, driven by the torque that
it would need to follow its motor. This swing is integrated, so that no torque has to be differentiated. The effect
changes the torque of all joints on which the link acts. It has an anti-resonance whose frequency does not depend on the
amplitude; with backlash the frequency does. Far below this frequency the effect looks like a delay or a rotor inertia;
motion with frequencies near the anti-resonance, or an encoder on the link, separates them. Friction and rotor are
assumed to be on the motor's side.
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

# Tried frequencies of the link on a stiff spring [Hz]. They are above the band of a recording: there the stiffness
# changes only the size of the effect, so that a coarse grid is enough.
_SWINGS = np.array([70.0, 35.0, 22.0, 14.0, 9.0])
# Tried frequencies on a soft spring [Hz]. They are within the band, where an error of a quarter spoils the fit.
_SOFT_SWINGS = np.array([7.2, 5.7, 4.5, 3.6, 2.9, 2.3, 1.8, 1.45])
# Largest ratio of a fitted compliance to that of its shape; it covers stiffnesses between two tried frequencies.
_SPREAD = 2.5
# Factors from a found compliance to those that are tried next.
_NEARBY = (0.75, 0.9, 1.0, 1.11, 1.33)
# Below this frequency [Hz] of its swing, a link has this usual damping ratio.
_SOFT, _DAMPING_OF_SOFT = 8.0, 0.04
# If a recording starts in motion (a joint is faster than `_MOVING` times its top speed), the deflection of the spring
# at the start is unknown. It then decays with a damping ratio of at least `_FADE`, which falls to the usual one in the
# last of `_FADING` swings.
_MOVING, _FADING, _FADE = 0.05, 3.0, 0.5
# Smallest and largest damping ratio that is tried.
_DAMPING_RANGE = (0.005, 0.3)
# Factors from a found damping ratio to those that are tried next.
_NEARBY_DAMPING = (0.4, 0.7, 1.4, 2.5)
Edges = tuple[float, float, float]
"""Lowest, usual and highest cutoff of the low pass of a load [Hz], see `followed_load`."""
_EDGES: Edges = (8.0, 12.0, np.inf)
# Frequency of a swing [Hz] below which anybody sees that a transmission is not rigid.
_SLOWEST = 1.0
# Smallest compliance [rad/(N m) or m/N]: a stiffer transmission is rigid.
_LEAST = 1e-10


class TransmissionCompliance(Effect):
    """Spring between motor and link of one joint. The coefficient is the compliance ``1/k``."""

    name = "transmission_compliance"
    regime = "high_acceleration"
    made_of = ("acceleration", "model")
    acts_as = "drive"
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
        """One parameter: ``stiffness``, which is k."""
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
        """Compliances for the tried frequencies, from stiff to soft, each with a damping ratio."""
        inertia = float(np.median(load_and_inertia(operation, row_of(robot, joint))[1]))
        tried = (float(inertia * (2.0 * np.pi * f) ** 2) for f in (*_SWINGS, *_SOFT_SWINGS))
        return tuple((1.0 / stiffness, usual_damping(stiffness, inertia)) for stiffness in tried)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """Shapes near the last one, then the last estimate; the estimate alone would not find a resonance."""
        compliance, damping = shape
        least, most = _DAMPING_RANGE
        dampings = (share * damping for share in _NEARBY_DAMPING)
        return (
            *((factor * compliance, damping) for factor in _NEARBY),
            *((compliance, other) for other in dampings if least <= other <= most),
            self.at_estimate(coefficients, shape),
        )

    def at_estimate(self, coefficients: Array, shape: Shape) -> Shape:
        """The fitted compliance, with the damping ratio of ``shape``."""
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
        """Bounds of the compliance, near that of the shape, which determines the frequency of the swing."""
        return ((shape[0] / _SPREAD, shape[0] * _SPREAD),)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """``k``, which is one over the compliance."""
        return np.array([1.0 / max(float(coefficients[0]), _LEAST)])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the compliance, which is zero for a rigid transmission; the stiffness is infinite."""
        return "compliance", np.array([1.0])

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of a compliance: one over that of a stiffness."""
        return "m/N" if robot.prismatic[row_of(robot, joint)] else "rad/(N m)"

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """The stiffness, from the compliance ``size``."""
        return (1.0 / size,) if size > 0 else None

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the encoder is on the link's side and does not show the deflection."""
        return behind_encoder(robot, row_of(robot, joint))

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Torque of the links at the readings minus that at their true positions."""
        row = row_of(robot, joint)
        return -exact_change_by_link(robot, operation, row, *swing(operation, row, theta.item()))

    def link_ahead(self, operation: Operation, joint: str | None, theta: Array) -> Array:
        """How far the link is ahead of its motor [rad or m], shape ``(N, nv)``."""
        out = np.zeros_like(operation.q)
        row = row_of(operation.robot, joint)
        out[:, row] = swing(operation, row, theta.item())[0]
        return out

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A transmission with a spring and a little damping, without play."""
        row = row_of(robot, joint)
        damping = 2.0 * SPRING_DAMPING * np.sqrt(theta.item() * moving_mass(robot, row))
        return Simulated(transmission=Transmission(robot.joint_names[row], theta.item(), float(damping), 0.0))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The stiffness, which describes the effect completely."""
        return ModelNumbers(whole=True, stiffness=theta.item())


def moving_mass(robot: Robot, row: int) -> float:
    """Reduced inertia ``I_rotor I_link / (I_rotor + I_link)`` of a joint, with all joints at zero."""
    rotor, link = float(robot.rotor_inertia[row]), link_inertia(robot, row)
    return rotor * link / (rotor + link)


def link_inertia(robot: Robot, row: int) -> float:
    """Inertia that a joint moves without its rotor, with all joints at zero."""
    return float(mass_matrix(robot, np.zeros((1, robot.nv)))[0, row, row]) - float(robot.rotor_inertia[row])


def usual_damping(stiffness: float, inertia: float) -> float:
    """Usual damping ratio of a link on a spring, for springs whose damping is unknown; soft springs have less."""
    return _DAMPING_OF_SOFT if stiffness < inertia * (2.0 * np.pi * _SOFT) ** 2 else SWING_DAMPING


def swing(operation: Operation, row: int, stiffness: float, damping: float | None = None) -> tuple[Array, Array, Array]:
    r"""How far the link of a joint is ahead of its motor, and its first two time derivatives, each of shape ``(N,)``.

    The deflection obeys :math:`m\,\ddot\delta + (d + c)\,\dot\delta + (k + g)\,\delta = -t_l`, with the torque
    :math:`t_l` that the link would need to follow its motor, and the derivatives :math:`m, c, g` of this torque by
    acceleration, velocity and position. It is integrated by the trapezoidal rule, which is stable for any stiffness,
    and starts in equilibrium. If the robot moves at the start, the first swings are damped more, so that a wrong
    deflection at the start has little effect.

    Args:
        operation: Motion and torque.
        row: Index of the joint.
        stiffness: Stiffness of the spring [N m/rad or N/m].
        damping: Damping ratio of the link on its spring; None for the usual one.
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
    deflection, rate, acceleration = swing_steps(0.5 * np.diff(operation.t), pull, spring, drag)
    return deflection, rate, acceleration


def followed_load(operation: Operation, row: int, edges: Edges) -> tuple[Array, Array]:
    """Torque that a transmission passes, low-passed to remove noise of encoder rounding, and the link's inertia.

    Args:
        operation: Motion and torque.
        row: Index of the joint.
        edges: Lowest, usual and highest cutoff [Hz]; the usual one is taken if no step of the encoder is stated.

    Returns:
        Load [N m or N] and inertia [kg m^2 or kg], both of shape ``(N,)``.
    """
    key = ("followed_load", row, edges)
    load, inertia = load_and_inertia(operation, row)
    if key not in operation.kept:
        edge = _edge(operation.t, load, float(np.median(inertia)), stated_step(operation.robot, row), edges)
        operation.kept[key] = _followed(operation.t, load, edge)
    return operation.kept[key], inertia


def swing_steps(half: Array, pull: Array, spring: Array, drag: Array) -> Array:
    """Position, velocity and acceleration of a damped mass on a spring under a given force, shape ``(3, N)``.

    Args:
        half: Half the time between samples [s], ``(N - 1,)``.
        pull: Acceleration by the force, ``(N,)``.
        spring: Deceleration per unit of position, ``(N,)``.
        drag: Deceleration per unit of velocity, ``(N,)``.
    """
    out = np.zeros((3, len(pull)))
    swing_loop(half, pull, spring, drag, out)
    return out


@jit
def swing_loop(half: Array, pull: Array, spring: Array, drag: Array, out: Array) -> None:
    """Compiled part of `swing_steps`; ``out`` is an array of zeros, because compiling an allocation takes long."""
    out[0, 0] = pull[0] / spring[0]
    x, v, a = out[0, 0], 0.0, 0.0
    for k in range(1, len(pull)):
        h = half[k - 1]
        # Position and velocity without the next acceleration; h^2 and h times this acceleration are added below.
        known_x, known_v = x + h * (2.0 * v + h * a), v + h * a
        a = (pull[k] - drag[k] * known_v - spring[k] * known_x) / (1.0 + h * (drag[k] + h * spring[k]))
        x, v = known_x + h * h * a, known_v + h * a
        out[0, k], out[1, k], out[2, k] = x, v, a


def _edge(t: Array, load: Array, inertia: float, step: float | None, edges: Edges) -> float:
    """Frequency [Hz] up to which ``load`` exceeds the noise due to an encoder that rounds to ``step``."""
    if step is None or len(t) < 16:
        return edges[1]
    rate = (len(t) - 1) / float(t[-1] - t[0])
    f, power = power_density(load, rate, min(len(t), int(2.0 * rate)))
    noise = (inertia * step * (2.0 * np.pi * f) ** 2) ** 2 / (6.0 * rate)
    noisy = np.flatnonzero((power < 4.0 * noise) & (f > edges[0]))
    return edges[2] if len(noisy) == 0 else min(float(f[noisy[0]]), edges[2])


def _followed(t: Array, load: Array, edge: float) -> Array:
    """``load`` low-passed at ``edge`` [Hz] without delay."""
    if len(t) < 16:
        return load
    rate = (len(t) - 1) / float(t[-1] - t[0])
    if edge > 0.4 * rate:
        return load
    return low_passed(load, edge, rate, order=2, padding=int(3 * rate / edge))
