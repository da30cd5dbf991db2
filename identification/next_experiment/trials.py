# pyright: reportAttributeAccessIssue=false
"""Motions that are tried: plain ones, with a known mass, and with softer gains of the controllers.

A mass that is known, carried along a motion: it parts what scales everything from what adds to one body.

What comes of a reference with softer position controllers: what moves the robot late parts delays from friction.

Motions that are tried: plain ones, with a known mass, and with softer gains of the controllers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from identification.data.changes import KnownPayload, with_payload
from identification.excitation.limited_quantities import bounds_of
from identification.excitation.limits import Limits
from identification.next_experiment.candidates import Candidate, candidates, design_of, lively, varied
from identification.next_experiment.laboratory import Laboratory
from identification.next_experiment.separation import LEAST_POWER, Rivalry, parting
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate

SHARES = (0.5, 0.2, 0.1, 0.05)
"""Masses that are tried, of the mass that the link has which carries them, to one digit."""


@dataclass(frozen=True)
class KnownMass:
    """A point mass [kg] at the payload frame, or with its centre [m] in the frame of the last moving joint."""

    mass: float
    center: tuple[float, float, float]
    frame: str | None


def known_mass(robot: Robot, share: float) -> KnownMass:
    """A share of the mass of the link that carries it, at the payload frame, else at twice the way to its centre."""
    body = payload_body(robot)
    inertia = robot.model.inertias[body]
    mass = _one_digit(share * max(float(inertia.mass), 0.02))
    frame = robot.payload_frame or "tip"
    if robot.model.existFrame(frame) and robot.model.frames[robot.model.getFrameId(frame)].parentJoint == body:
        return KnownMass(mass, (0.0, 0.0, 0.0), frame)
    x, y, z = (round(2.0 * float(c), 3) for c in inertia.lever)
    return KnownMass(mass, (x, y, z), None)


def carried(robot: Robot, mass: KnownMass) -> Robot:
    """The robot with the mass on it."""
    return with_payload(robot, KnownPayload(mass.mass, mass.center))


def _one_digit(x: float) -> float:
    return float(f"{np.maximum(x, 1e-3):.0e}")


GAINS = (0.5, 0.25)
"""Shares of the stated gains that are tried; larger gains may shake a robot."""


def followed(robot: Robot, reference: Motion, share: float) -> Motion | None:
    """The motion of the given model along a reference, ``kp`` and ``kd`` of all its controllers at a share.

    Args:
        robot: The given model; the delays of its controllers are left out.
        reference: What is asked for, from rest.
        share: Of the gains that the robot states.

    Returns:
        None if a joint states no controller, or the robot does not follow.
    """
    controllers = [drive.controller for drive in robot.actuators]
    stated = [controller for controller in controllers if controller is not None and controller.kp > 0]
    if not controllers or len(stated) < len(controllers):
        return None
    kp, kd = (share * np.array(gains) for gains in ([c.kp for c in stated], [c.kd for c in stated]))
    law = position_control(reference.t, reference.q, np.zeros_like(reference.q), kp=kp, kd=kd)
    instant = replace(robot, torque_hold="instant")
    try:
        return simulate(instant, (), law, reference.t, reference.q[0]).links
    except ParameterError:
        return None


Array = np.ndarray

# Motions that are drawn, and variations of the best one: as many as take a second or two.
_WORK, _FEWEST, _MOST = 120, 12, 40
# So many of the best ones are tried with a known mass and with softer gains too, if they can be made so.
_CHANGED = 3
# Probability above which a further difference counts by its size.
_SURE = 0.995
# By so much a mass or other gains have to raise the probability that no rival is left.
_BURDEN = 0.1


@dataclass(frozen=True)
class Trial:
    """One motion, and how well it would separate the rivals.

    Attributes:
        candidate: The motion.
        mass: Carried along it; None for nothing.
        gains: Share of the stated gains that the position controllers have then; None for all of them.
        power: Probability that each pair is parted.
        gain: Squared distance of each pair.
        resolved: Probability that a finding loses its hardest rival, on average over the findings.
    """

    candidate: Candidate
    mass: KnownMass | None
    gains: float | None
    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    resolved: float

    @property
    def parts(self) -> bool:
        """True if it parts any pair."""
        return bool((self.power >= LEAST_POWER).any())

    @property
    def certain(self) -> bool:
        """True if nothing is left to be gained."""
        return self.resolved >= _SURE

    @property
    def worth(self) -> tuple[bool, float, float]:
        """Whether it parts a pair, how likely it leaves no rival, and the smallest squared distance it parts by."""
        parted = self.gain[self.power >= LEAST_POWER] if self.parts else self.gain
        return (self.parts, min(self.resolved, _SURE), float(parted.min(initial=np.inf)))


def tried(
    robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...], duration: float
) -> tuple[Trial, ...]:
    """Motions and how well they part the pairs, the best first; with a mass or softer gains where that parts more.

    Raises:
        ParameterError: If no motion keeps the limits.
    """
    rng = random_stream("motions of a next experiment")
    count = int(np.clip(_WORK // robot.nv**2, _FEWEST, _MOST))
    problem = design_of(robot, limits)
    drawn = candidates(problem, duration=duration, count=count, rng=rng)
    if not drawn:
        return ()
    trials = [judged(candidate, robot, lab, rivalries) for candidate in drawn]
    trials.sort(key=lambda trial: trial.worth, reverse=True)
    for _ in range(0 if trials[0].certain else count):
        candidate = varied(trials[0].candidate, problem, rng)
        other = judged(candidate, robot, lab, rivalries) if lively(candidate, problem) else trials[0]
        if other.worth > trials[0].worth:
            trials.insert(0, other)
    if (trials[0].power >= LEAST_POWER).all():
        return tuple(trials)
    changed = (
        *islice(_there(loaded_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials), _CHANGED),
        *islice(_there(softer_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials), _CHANGED),
    )
    # A mass is a burden, and so are other gains: they have to part more than the best motion without them does.
    more = [trial for trial in changed if trial.parts and trial.resolved > trials[0].resolved + _BURDEN]
    return (*sorted(more, key=lambda trial: trial.worth, reverse=True), *trials)


def loaded_trial(
    candidate: Candidate, robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion with the largest mass that the drives can carry along it; None if they can carry none."""
    for share in SHARES:
        mass = known_mass(robot, share)
        loaded = carried(robot, mass)
        if keeps(loaded, limits, candidate.motion(candidate.shapes.samples / candidate.shapes.duration)):
            return judged(candidate, loaded, lab, rivalries, mass=mass)
    return None


def softer_trial(
    candidate: Candidate, robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion as a reference of softer controllers, the better share; None if the robot states no controllers."""
    out = []
    for share in GAINS:
        motion = followed(robot, candidate.motion(lab.band.rate_hz), share)
        if motion is not None and stays(robot, limits, motion) and keeps(robot, limits, motion):
            out.append(judged(candidate, robot, lab, rivalries, gains=share, motion=motion))
    return max(out, key=lambda trial: trial.worth, default=None)


def judged(
    candidate: Candidate,
    robot: Robot,
    lab: Laboratory,
    rivalries: tuple[Rivalry, ...],
    *,
    mass: KnownMass | None = None,
    gains: float | None = None,
    motion: Motion | None = None,
) -> Trial:
    """How well a motion parts all pairs; ``motion`` is what comes of the candidate, if that is not itself."""
    planned = lab.products(candidate.motion(lab.band.rate_hz) if motion is None else motion, robot)
    each = [parting(rivalry, planned) for rivalry in rivalries]
    power, gain = (np.concatenate(parts) for parts in ([one.power for one in each], [one.gain for one in each]))
    return Trial(candidate, mass, gains, power, gain, float(np.mean([one.resolved for one in each])))


def keeps(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if the drives of a robot that carries something, or is led softly, keep their limits along a motion."""
    usable = bounds_of(robot, limits)
    torque = inverse_dynamics(robot, motion)
    return bool((np.abs(torque) <= usable.upper[-robot.nv :] + np.array(robot.coulomb_friction)).all())


def stays(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if the active joints keep their limits of position and speed."""
    rows = list(robot.tree_rows)
    inside = (motion.q >= limits.lower[rows]) & (motion.q <= limits.upper[rows])
    return bool((inside & (np.abs(motion.v) <= limits.velocity[rows])).all())


def _there(trials: Iterable[Trial | None]) -> Iterator[Trial]:
    return (trial for trial in trials if trial is not None)
