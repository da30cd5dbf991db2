# pyright: reportAttributeAccessIssue=false
"""Proposes the recording that separates the rivals of a diagnosis best.

Motions are scored by how well they separate rivals (T-optimal design): motions of the robot as it is, with a known
mass, or with softer gains. A known mass separates effects on the whole torque from effects on one body. Softer position
controllers separate delays from friction. The proposal is a sentence and a reference motion.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from identification.csv_cells import header_line
from identification.data.changes import KnownPayload, with_payload
from identification.data.log import Log
from identification.data.signals import shortest_recording
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.result import Finding
from identification.diagnosis.search.refinement import found_effects
from identification.engine import contract_levels
from identification.excitation.limits import Limits, bounds_of
from identification.next_experiment.candidates import (
    Candidate,
    candidates,
    design_of,
    exciting,
    fast_enough,
    safe_limits,
    varied,
)
from identification.next_experiment.hypotheses import hypotheses_of, union_of, with_all_findings
from identification.next_experiment.planned_recording import PlannedRecording, planned_recording
from identification.next_experiment.separation import Pair, Rivalry, rivalry_of, separation
from identification.notes import Code, Note
from identification.words.diagnosis_words import percent
from identification.words.notes_on_findings import RivalPair, pairs_words
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ChainError, ParameterError, RobotError
from phantom_dyn.model.inertia import payload_body, tip_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate

SHARES = (0.5, 0.2, 0.1, 0.05)
"""Known masses that are tried in turn, as shares of the mass of the link that carries them."""
GAINS = (0.5, 0.25)
"""Gains of softer controllers, as shares of the stated gains. Larger gains are not tried: a robot might vibrate."""
# Number of random motions, and of variations of the best one: ``_WORK / nv^2``, limited to the other two numbers. They
# take a second or two.
_WORK, _FEWEST, _MOST = 120, 12, 40
# Number of the best motions that are also scored with a known mass and with softer gains.
_CHANGED = 3
# Larger probabilities of separation count as equal; such motions are compared by the distance of rivals instead.
_SURE = 0.995
# A known mass or softer gains are proposed only if they increase the probability that no rival remains by this much,
# because they take the user more effort than another motion.
_BURDEN = 0.1


@dataclass(frozen=True)
class KnownMass:
    """A point mass [kg], its centre [m] as in ``recordings.yaml``, and in words the frame of the centre."""

    mass: float
    center: tuple[float, float, float]
    frame: str


def known_mass(robot: Robot, share: float) -> KnownMass:
    """A point mass that is a share of the mass of the link that carries it.

    The mass is at the stated payload frame, else at the frame ``tip``, else at twice the distance of the link's centre
    of mass from the joint.
    """
    body = payload_body(robot)
    inertia = robot.model.inertias[body]
    # Rounded to one digit, and at least a gram.
    mass = float(f"{max(share * max(float(inertia.mass), 0.02), 1e-3):.0e}")
    if robot.payload_frame is not None:
        return KnownMass(mass, (0.0, 0.0, 0.0), f"frame {robot.payload_frame}")
    tip = tip_of(robot)
    # Rounded to a millimetre, so that the sentence states exactly the tried numbers; + 0.0 removes the sign of zero.
    x, y, z = (round(float(c), 3) + 0.0 for c in (2.0 * inertia.lever if tip is None else tip))
    return KnownMass(mass, (x, y, z), f"the frame of joint {robot.model.names[body]}")


def simulated_tracking(robot: Robot, reference: Motion, share: float) -> Motion | None:
    """Simulated motion with reduced controller gains; None if one is not stated, or the simulation diverges.

    Args:
        robot: The given model; the delays of its controllers are ignored.
        reference: Reference motion, from rest.
        share: Share of the stated gains.
    """
    controllers = [drive.controller for drive in robot.actuators]
    stated = [controller for controller in controllers if controller is not None and controller.kp > 0]
    if not controllers or len(stated) < len(controllers):
        return None
    kp = share * np.array([controller.kp for controller in stated])
    kd = share * np.array([controller.kd for controller in stated])
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
        mass: Known mass that the robot carries; None without a mass.
        gains: Gains of the position controllers as a share of the stated gains; None for the stated gains.
        power: Probability that each pair of rivals is separated, shape ``(p,)``.
        gain: Squared distance of the torques of each pair, shape ``(p,)``.
        resolved: Probability that the rival of a finding that is hardest to separate is ruled out, averaged over the
            findings.
    """

    candidate: Candidate
    mass: KnownMass | None
    gains: float | None
    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    resolved: float

    @property
    def separates(self) -> bool:
        """True if the motion separates at least one pair with sufficient probability."""
        return bool((self.power >= rules.SEPARATED).any())

    @property
    def worth(self) -> tuple[bool, float, float]:
        """Sort key: True if a pair is separated, probability that no rival remains, least distance of such pairs."""
        separated = self.gain[self.power >= rules.SEPARATED] if self.separates else self.gain
        return (self.separates, min(self.resolved, _SURE), float(separated.min(initial=np.inf)))


def ranked_trials(
    robot: Robot, limits: Limits, recording: PlannedRecording, rivalries: tuple[Rivalry, ...], duration: float
) -> tuple[Trial, ...]:
    """Motions scored by how well they separate the pairs, the best first, some with a known mass or softer gains.

    Raises:
        ParameterError: If no motion keeps the limits.
    """
    rng = random_stream("motions of a next experiment")
    count = int(np.clip(_WORK // robot.nv**2, _FEWEST, _MOST))
    problem = design_of(robot, limits)
    drawn = candidates(problem, duration=duration, count=count, rng=rng)
    drawn = (*drawn, exciting(problem, duration, random_stream("exciting motion of a next experiment")))
    trials = [trial_of(candidate, robot, recording, rivalries) for candidate in drawn]
    trials.sort(key=lambda trial: trial.worth, reverse=True)
    for _ in range(0 if _is_best(trials) else count):
        candidate = varied(trials[0].candidate, problem, rng)
        other = trial_of(candidate, robot, recording, rivalries) if fast_enough(candidate, problem) else trials[0]
        if other.worth > trials[0].worth:
            trials.insert(0, other)
    if (trials[0].power >= rules.SEPARATED).all():
        return tuple(trials)
    loaded = (loaded_trial(trial.candidate, robot, limits, recording, rivalries) for trial in trials)
    softer = (softer_trial(trial.candidate, robot, limits, recording, rivalries) for trial in trials)
    changed = (*islice(filter(None, loaded), _CHANGED), *islice(filter(None, softer), _CHANGED))
    better = [trial for trial in changed if trial.separates and trial.resolved > trials[0].resolved + _BURDEN]
    return (*sorted(better, key=lambda trial: trial.worth, reverse=True), *trials)


def _is_best(trials: list[Trial]) -> bool:
    """True if variations of the best motion cannot be much better: each pair is separated by it, or by no motion."""
    never = np.max([trial.power for trial in trials], axis=0) < contract_levels.LISTED
    return trials[0].resolved >= _SURE or bool((never | (trials[0].power >= _SURE)).all())


def loaded_trial(
    candidate: Candidate, robot: Robot, limits: Limits, recording: PlannedRecording, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion with the largest known mass that the drives can carry along it; None if they can carry none."""
    for share in SHARES:
        mass = known_mass(robot, share)
        loaded = with_payload(robot, KnownPayload(mass.mass, mass.center))
        if within_torque_limits(loaded, limits, candidate.motion(candidate.shapes.samples / candidate.shapes.duration)):
            return trial_of(candidate, loaded, recording, rivalries, mass=mass)
    return None


def softer_trial(
    candidate: Candidate, robot: Robot, limits: Limits, recording: PlannedRecording, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion as the reference of softer controllers, with the better one of `GAINS`; None if none is possible."""
    out = []
    for share in GAINS:
        motion = simulated_tracking(robot, candidate.motion(recording.band.rate_hz), share)
        if motion is None or not within_motion_limits(robot, limits, motion):
            continue
        if within_torque_limits(robot, limits, motion):
            out.append(trial_of(candidate, robot, recording, rivalries, gains=share, motion=motion))
    return max(out, key=lambda trial: trial.worth, default=None)


def trial_of(
    candidate: Candidate,
    robot: Robot,
    recording: PlannedRecording,
    rivalries: tuple[Rivalry, ...],
    *,
    mass: KnownMass | None = None,
    gains: float | None = None,
    motion: Motion | None = None,
) -> Trial:
    """A candidate scored on all pairs of rivals.

    Args:
        candidate: The motion, or the reference of softer controllers.
        robot: The robot, with the mass if there is one.
        recording: The planned recording, which computes products of columns along a motion.
        rivalries: The rivals to separate.
        mass: Known mass that the robot carries.
        gains: Share of the stated gains of the controllers.
        motion: Motion of the robot, if it differs from the candidate.
    """
    planned = recording.products(candidate.motion(recording.band.rate_hz) if motion is None else motion, robot)
    separations = [separation(rivalry, planned) for rivalry in rivalries]
    power = np.concatenate([one.power for one in separations])
    gain = np.concatenate([one.gain for one in separations])
    return Trial(candidate, mass, gains, power, gain, float(np.mean([one.resolved for one in separations])))


def within_torque_limits(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if a motion needs no torque beyond the limits of the drives."""
    usable = bounds_of(robot, limits)
    rows = [usable.labels.index(f"torque of {joint}") for joint in robot.joint_names]
    torque = inverse_dynamics(robot, motion)
    return bool((np.abs(torque) <= usable.upper[rows] + np.array(robot.coulomb_friction)).all())


def within_motion_limits(robot: Robot, limits: Limits, motion: Motion) -> bool:
    """True if a motion stays within the limits of position and speed of the active joints."""
    rows = list(robot.tree_rows)
    inside = (motion.q >= limits.lower[rows]) & (motion.q <= limits.upper[rows])
    return bool((inside & (np.abs(motion.v) <= limits.velocity[rows])).all())


REFERENCE = "next.csv"
# Largest number of findings whose rivals are to be separated; the largest findings are taken.
_FINDINGS = 3
# The duration of a proposed recording is that of the recordings, within these limits [s].
_SHORTEST, _LONGEST = 8.0, 20.0
# The sample rate of a reference is that of the recordings, but at most this rate of a usual controller [Hz].
_RATE_HZ = 1000.0


@dataclass(frozen=True)
class Proposal:
    """The recording to make next.

    Attributes:
        experiment: The entry ``next_experiment`` of ``diagnosis.json``; None if nothing is proposed.
        motion: The reference motion.
        notes: Notes on rivals that the proposed recording would not separate.
    """

    experiment: dict | None = None
    motion: Motion | None = None
    notes: tuple[Note, ...] = ()


def proposed(explanation: Explanation, findings: tuple[Finding, ...]) -> Proposal:
    """The recording to make next; an empty proposal if no motion separates rivals of a finding.

    Args:
        explanation: All effects that the search has found, including those that are not shown as findings.
        findings: Findings that are shown.
    """
    chosen = with_all_findings(explanation.search, explanation.chosen, findings)
    search = explanation.search.of(chosen)
    session = search.problem.session
    with_rivals = filter(None, (hypotheses_of(search, chosen, finding) for finding in findings))
    groups = tuple(islice(with_rivals, _FINDINGS))
    if not groups:
        return Proposal()
    found = found_effects(search.held_out_fit(chosen), chosen)
    union = union_of(tuple(one for group in groups for one in group))
    recording = planned_recording(search.problem, explanation.noise, union, found)
    try:
        limits = safe_limits(session.robot, session.logs)
        rivalries = rivalry_of(search, groups)
        trials = ranked_trials(session.robot, limits, recording, rivalries, length_of(session.logs))
    except (RobotError, ParameterError, ChainError) as problem:
        return Proposal(notes=(Note(Code.NO_EXPERIMENT, None, {"problem": str(problem)}),))
    except np.linalg.LinAlgError:
        return Proposal(notes=(Note(Code.NO_EXPERIMENT),))
    return _proposal(min(session.logs[0].band.rate_hz, _RATE_HZ), rivalries, trials)


def length_of(logs: tuple[Log, ...]) -> float:
    """Duration of a proposed recording [s]: that of the recordings, but from 8 to 20 s.

    At a low sample rate it may be longer, so that the filter of the band has enough samples.
    """
    seconds = float(np.mean([log.motion.t[-1] - log.motion.t[0] for log in logs]))
    fewest = max(shortest_recording(log.band) for log in logs)
    return max(float(np.clip(round(seconds), _SHORTEST, _LONGEST)), fewest)


def _proposal(rate_hz: float, rivalries: tuple[Rivalry, ...], trials: tuple[Trial, ...]) -> Proposal:
    """The best trial as a proposal, with a note on pairs that it does not separate."""
    pairs = tuple(pair for rivalry in rivalries for pair in rivalry.pairs)
    best = trials[0]
    if not best.separates:
        return Proposal(notes=(_not_separated(pairs),))
    separated = tuple(pair for pair, power in zip(pairs, best.power, strict=True) if power >= rules.SEPARATED)
    others = tuple(pair for pair in pairs if pair not in separated)
    effects = dict.fromkeys(
        (at.effect, at.joint) for pair in separated for one in (pair.one, pair.other) for at in one.effects
    )
    power = float(best.power[best.power >= rules.SEPARATED].min())
    experiment = {
        "separates": [list(effect) for effect in effects],
        "reference": REFERENCE,
        "expected_power": power,
        "say": proposal_words(separated, best, REFERENCE, power),
    }
    return Proposal(experiment, best.candidate.motion(rate_hz), (_not_separated(others),) if others else ())


def proposal_words(separated: tuple[Pair, ...], trial: Trial, reference: str, power: float) -> str:
    """One sentence on the motion to record and on the rivals that it separates."""
    load = stated = ""
    if trial.mass is not None:
        load, stated = f" with {_mass_words(trial.mass)}", f", write {_entry(trial.mass)}"
    if trial.gains is not None:
        load = f" with the gains of the position controllers at {percent(trial.gains)} of those in robot.yaml"
        stated = ", write these gains as its controller"
    # A diagnosis knows a mass or gains only if the user states them in recordings.yaml.
    stated += " beside its file name in recordings.yaml," if stated else ""
    motion = f"{trial.candidate.shapes.duration:g} s, {trial.candidate.kind}"
    safe = "at most half of the recorded range beyond its ends, and twice the recorded speeds and torques"
    return (
        f"Record the motion of {reference}{load} ({motion}, {safe}; obstacles are not checked){stated} and "
        f"diagnose it together with this recording: with a probability of {percent(power)} it separates "
        f"{pairs_words(_effects_of(separated))}."
    )


def _not_separated(pairs: tuple[Pair, ...]) -> Note:
    """A note on rivals that no safe motion separates."""
    return Note(Code.NOT_SEPARATED, None, {"pairs": _effects_of(pairs)})


def _effects_of(pairs: tuple[Pair, ...]) -> tuple[RivalPair, ...]:
    """The effects of both explanations of each pair."""
    return tuple((pair.one.effects, pair.other.effects) for pair in pairs)


def _mass_words(mass: KnownMass) -> str:
    """The mass and its place in words."""
    x, y, z = mass.center
    return f"a known mass of {mass.mass:g} kg at ({x:g}, {y:g}, {z:g}) m of {mass.frame}"


def _entry(mass: KnownMass) -> str:
    """The mass as an entry of ``recordings.yaml``."""
    return f"payload: {{mass: {mass.mass:g}, center: [{', '.join(f'{x:g}' for x in mass.center)}]}}"


def reference_text(motion: Motion, joint_names: tuple[str, ...]) -> str:
    """CSV with ``t``, ``q_ref.<joint>``, ``v_ref.<joint>`` and ``a_ref.<joint>``, not rounded."""
    names = ["t", *(f"{kind}.{joint}" for kind in ("q_ref", "v_ref", "a_ref") for joint in joint_names)]
    rows = np.column_stack([motion.t, motion.q, motion.v, motion.a])
    out = io.StringIO()
    np.savetxt(out, rows, delimiter=",", header=header_line(names), comments="", fmt="%.17g")
    return out.getvalue()
