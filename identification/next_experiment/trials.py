# pyright: reportAttributeAccessIssue=false
"""Motions scored by how well they separate rivals (T-optimal design): plain, with a known mass, or with softer gains.

A known mass carried along a motion separates what scales the whole torque from what adds to one body. Softer position
controllers separate delays from friction.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from identification.data.changes import KnownPayload, with_payload
from identification.diagnosis import decision_rules as rules
from identification.engine import contract_levels
from identification.excitation.limited_quantities import bounds_of
from identification.excitation.limits import Limits
from identification.next_experiment.candidates import Candidate, candidates, design_of, exciting, lively, varied
from identification.next_experiment.laboratory import Laboratory
from identification.next_experiment.separation import Rivalry, separation
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ChainError, ParameterError
from phantom_dyn.model.inertia import payload_body, tip_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate

SHARES = (0.5, 0.2, 0.1, 0.05)
"""Known masses in the order of trial, as shares of the mass of the link that carries them, to one digit."""
GAINS = (0.5, 0.25)
"""Softer controllers, as shares of the stated gains; larger gains may shake a robot."""
# Motions drawn, and variations of the best one: ``_WORK / nv^2`` within these, as many as take a second or two.
_WORK, _FEWEST, _MOST = 120, 12, 40
# Number of the best motions that are scored with a known mass and with softer gains too, where possible.
_CHANGED = 3
# Probability above which a further difference counts by its size.
_SURE = 0.995
# Least gain in the probability that no rival is left, for which a mass or other gains are worth their burden.
_BURDEN = 0.1


@dataclass(frozen=True)
class KnownMass:
    """A point mass [kg] with its centre [m], as ``recordings.yaml`` states it, and the frame that this counts from."""

    mass: float
    center: tuple[float, float, float]
    frame: str


def known_mass(robot: Robot, share: float) -> KnownMass:
    """A share of the mass of the link that carries it.

    It is at the payload frame that is stated, else at the frame ``tip``, else at twice the way to the link's centre.
    """
    body = payload_body(robot)
    inertia = robot.model.inertias[body]
    mass = _one_digit(share * max(float(inertia.mass), 0.02))
    if robot.payload_frame is not None:
        return KnownMass(mass, (0.0, 0.0, 0.0), f"frame {robot.payload_frame}")
    tip = tip_of(robot)
    # To a millimetre, so that the sentence says the numbers that were tried; a zero has no sign.
    x, y, z = (round(float(c), 3) + 0.0 for c in (2.0 * inertia.lever if tip is None else tip))
    return KnownMass(mass, (x, y, z), f"the frame of joint {robot.model.names[body]}")


def carried(robot: Robot, mass: KnownMass) -> Robot:
    """The robot with the mass on it."""
    return with_payload(robot, KnownPayload(mass.mass, mass.center))


def _one_digit(x: float) -> float:
    return float(f"{np.maximum(x, 1e-3):.0e}")


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
    except (ParameterError, ChainError):
        return None


@dataclass(frozen=True)
class Trial:
    """One motion with its power to separate the rivals.

    Attributes:
        candidate: The motion.
        mass: Carried along it; None for nothing.
        gains: Share of the stated gains that the position controllers have then; None for all of them.
        power: Probability that each pair is separated.
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
    def separates(self) -> bool:
        """True if it separates any pair."""
        return bool((self.power >= rules.SEPARATED).any())

    @property
    def worth(self) -> tuple[bool, float, float]:
        """Sort key: separates a pair, probability that no rival is left, smallest squared distance it separates."""
        separated = self.gain[self.power >= rules.SEPARATED] if self.separates else self.gain
        return (self.separates, min(self.resolved, _SURE), float(separated.min(initial=np.inf)))


def ranked_trials(
    robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...], duration: float
) -> tuple[Trial, ...]:
    """Score motions by their separation of the pairs, the best first; with a mass or softer gains where these help.

    Raises:
        ParameterError: If no motion keeps the limits.
    """
    rng = random_stream("motions of a next experiment")
    count = int(np.clip(_WORK // robot.nv**2, _FEWEST, _MOST))
    problem = design_of(robot, limits)
    drawn = candidates(problem, duration=duration, count=count, rng=rng)
    drawn = (*drawn, exciting(problem, duration, random_stream("exciting motion of a next experiment")))
    trials = [trial_of(candidate, robot, lab, rivalries) for candidate in drawn]
    trials.sort(key=lambda trial: trial.worth, reverse=True)
    for _ in range(0 if _is_best(trials) else count):
        candidate = varied(trials[0].candidate, problem, rng)
        other = trial_of(candidate, robot, lab, rivalries) if lively(candidate, problem) else trials[0]
        if other.worth > trials[0].worth:
            trials.insert(0, other)
    if (trials[0].power >= rules.SEPARATED).all():
        return tuple(trials)
    changed = (
        *islice(_there(loaded_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials), _CHANGED),
        *islice(_there(softer_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials), _CHANGED),
    )
    # A mass is a burden, and so are other gains: they have to separate more than the best motion without them does.
    more = [trial for trial in changed if trial.separates and trial.resolved > trials[0].resolved + _BURDEN]
    return (*sorted(more, key=lambda trial: trial.worth, reverse=True), *trials)


def _is_best(trials: list[Trial]) -> bool:
    """True if no variation of the best motion can be noticeably better: each pair is separated, or by no motion."""
    never = np.max([trial.power for trial in trials], axis=0) < contract_levels.LISTED
    return trials[0].resolved >= _SURE or bool((never | (trials[0].power >= _SURE)).all())


def loaded_trial(
    candidate: Candidate, robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion with the largest mass that the drives can carry along it; None if they can carry none."""
    for share in SHARES:
        mass = known_mass(robot, share)
        loaded = carried(robot, mass)
        if keeps(loaded, limits, candidate.motion(candidate.shapes.samples / candidate.shapes.duration)):
            return trial_of(candidate, loaded, lab, rivalries, mass=mass)
    return None


def softer_trial(
    candidate: Candidate, robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion as a reference of softer controllers, the better share; None if the robot states no controllers."""
    out = []
    for share in GAINS:
        motion = followed(robot, candidate.motion(lab.band.rate_hz), share)
        if motion is not None and stays(robot, limits, motion) and keeps(robot, limits, motion):
            out.append(trial_of(candidate, robot, lab, rivalries, gains=share, motion=motion))
    return max(out, key=lambda trial: trial.worth, default=None)


def trial_of(
    candidate: Candidate,
    robot: Robot,
    lab: Laboratory,
    rivalries: tuple[Rivalry, ...],
    *,
    mass: KnownMass | None = None,
    gains: float | None = None,
    motion: Motion | None = None,
) -> Trial:
    """Score a candidate on all pairs; ``motion`` is the motion that follows from it, if that differs."""
    planned = lab.products(candidate.motion(lab.band.rate_hz) if motion is None else motion, robot)
    each = [separation(rivalry, planned) for rivalry in rivalries]
    power, gain = (np.concatenate(values) for values in ([one.power for one in each], [one.gain for one in each]))
    return Trial(candidate, mass, gains, power, gain, float(np.mean([one.resolved for one in each])))


def keeps(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if the drives of a loaded or softly controlled robot keep their limits along a motion."""
    usable = bounds_of(robot, limits)
    rows = [usable.labels.index(f"torque of {joint}") for joint in robot.joint_names]
    torque = inverse_dynamics(robot, motion)
    return bool((np.abs(torque) <= usable.upper[rows] + np.array(robot.coulomb_friction)).all())


def stays(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if the active joints keep their limits of position and speed."""
    rows = list(robot.tree_rows)
    inside = (motion.q >= limits.lower[rows]) & (motion.q <= limits.upper[rows])
    return bool((inside & (np.abs(motion.v) <= limits.velocity[rows])).all())


def _there(trials: Iterable[Trial | None]) -> Iterator[Trial]:
    return (trial for trial in trials if trial is not None)
