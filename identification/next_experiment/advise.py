"""From a diagnosis with rivals to the recording that parts them."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import combinations, islice

import numpy as np
from jaxtyping import Float

from identification.diagnosis.result import Diagnosis
from identification.diagnosis.retaken import found_effects
from identification.diagnosis.search import Search
from identification.diagnosis.terms import KnownEffect, Term
from identification.excitation.bounds import bounds_of
from identification.excitation.limits import Limits
from identification.log import Log
from identification.next_experiment.candidates import Candidate, candidates, lively, varied
from identification.next_experiment.hypotheses import Hypothesis, hypotheses_of, union_of
from identification.next_experiment.known_mass import SHARES, KnownMass, carried, known_mass
from identification.next_experiment.products import Laboratory, laboratory
from identification.next_experiment.propose import LEAST_POWER, Pair, Rivalry, parting, rivalry_of
from identification.next_experiment.safe import safe_limits
from identification.next_experiment.say import nothing_parts, proposal_words
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.robot import Robot

Array = np.ndarray

REFERENCE = "next.csv"
# Findings whose rivals are to be parted, the largest first.
_FINDINGS = 3
# Motions that are drawn, and variations of the best one: as many as take a second or two.
_WORK, _FEWEST, _MOST = 120, 12, 40
# So many of the best ones that can be made with a known mass are tried with it too.
_LOADED = 3
_SEED = 20260109
# Length of a proposed recording [s]: that of those at hand, within these.
_SHORTEST, _LONGEST = 8.0, 20.0
# Rows per second of a reference: those of the recordings, no more than a controller's clock.
_RATE_HZ = 1000.0
# Probability above which a further difference counts by its size.
_SURE = 0.995
# By so much a known mass has to raise the probability that no rival is left.
_BURDEN = 0.1


@dataclass(frozen=True)
class Trial:
    """One motion, and how well it would part the rivals.

    Attributes:
        candidate: The motion.
        mass: Carried along it; None for nothing.
        power: Probability that each pair is parted.
        gain: Squared distance of each pair.
        resolved: Probability that a finding loses its hardest rival, on average over the findings.
    """

    candidate: Candidate
    mass: KnownMass | None
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


def with_next_experiment(
    diagnosis: Diagnosis,
    robot: Robot,
    logs: tuple[Log, ...],
    search: Search,
    chosen: frozenset[Term],
    noise: tuple[Float[Array, "_ nv"], ...],
    cutoff_hz: float,
    known: tuple[KnownEffect, ...] = (),
) -> Diagnosis:
    """The diagnosis with the recording to make next, where a finding has rivals that one can part.

    Args:
        diagnosis: What was found.
        robot: The given model.
        logs: Recordings, those held out at the end.
        search: What the effects were chosen by.
        chosen: All effects that it has found, those too that are not told.
        noise: Of the torque, for each log.
        cutoff_hz: Edge of the judged band.
        known: Effects that belong to the given model already.
    """
    started = time.perf_counter()
    groups = tuple(group for finding in diagnosis.findings if (group := hypotheses_of(search, chosen, finding)))
    groups = groups[:_FINDINGS]
    if not groups:
        return diagnosis
    found = found_effects(search.evaluate(chosen), chosen)
    union = union_of(tuple(one for group in groups for one in group))
    lab = laboratory(robot, logs, search.problem, noise, cutoff_hz, union, known, found)
    try:
        limits = safe_limits(robot, logs)
        trials = tried(robot, limits, lab, rivalry_of(search, groups), _duration(logs))
    except (RobotError, ParameterError) as problem:
        out = replace(diagnosis, notes=(*diagnosis.notes, f"No further experiment is proposed: {problem}"))
    except np.linalg.LinAlgError:
        note = "No further experiment is proposed: the fits of the rivals cannot be compared; take a longer recording."
        out = replace(diagnosis, notes=(*diagnosis.notes, note))
    else:
        out = _told(diagnosis, logs, groups, trials)
    return replace(out, seconds=diagnosis.seconds + time.perf_counter() - started)


def tried(
    robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...], duration: float
) -> tuple[Trial, ...]:
    """Motions and how well they part the pairs, the best first; with a known mass where that parts more.

    Raises:
        ParameterError: If no motion keeps the limits.
    """
    rng = np.random.default_rng(_SEED)
    count = int(np.clip(_WORK // robot.nv**2, _FEWEST, _MOST))
    drawn = candidates(robot, limits, duration=duration, count=count, rng=rng)
    if not drawn:
        return ()
    trials = [judged(candidate, None, robot, lab, rivalries) for candidate in drawn]
    trials.sort(key=lambda trial: trial.worth, reverse=True)
    for _ in range(0 if trials[0].certain else count):
        candidate = varied(trials[0].candidate, robot, limits, rng)
        other = judged(candidate, None, robot, lab, rivalries) if lively(candidate, limits, robot) else trials[0]
        if other.worth > trials[0].worth:
            trials.insert(0, other)
    if (trials[0].power >= LEAST_POWER).all():
        return tuple(trials)
    carrying = (loaded_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials)
    with_mass = tuple(islice((trial for trial in carrying if trial is not None), _LOADED))
    # A mass is a burden: it has to part more than the best motion without one does.
    more = [trial for trial in with_mass if trial.parts and trial.resolved > trials[0].resolved + _BURDEN]
    return (*sorted(more, key=lambda trial: trial.worth, reverse=True), *trials)


def loaded_trial(
    candidate: Candidate, robot: Robot, limits: Limits, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial | None:
    """The motion with the largest mass that the drives can carry along it; None if they can carry none."""
    for share in SHARES:
        mass = known_mass(robot, share)
        loaded = carried(robot, mass)
        if keeps(loaded, limits, candidate):
            return judged(candidate, mass, loaded, lab, rivalries)
    return None


def judged(
    candidate: Candidate, mass: KnownMass | None, robot: Robot, lab: Laboratory, rivalries: tuple[Rivalry, ...]
) -> Trial:
    """How well a motion parts all pairs."""
    planned = lab.products(candidate.motion(lab.band.rate_hz), robot)
    each = [parting(rivalry, planned) for rivalry in rivalries]
    power, gain = (np.concatenate(parts) for parts in ([one.power for one in each], [one.gain for one in each]))
    return Trial(candidate, mass, power, gain, float(np.mean([one.resolved for one in each])))


def keeps(robot: Robot, limits: Limits, candidate: Candidate) -> bool:
    """True if a robot that carries something keeps its limits along a motion."""
    usable = bounds_of(robot, limits)
    motion = candidate.motion(candidate.shapes.samples / candidate.shapes.duration)
    torque = inverse_dynamics(robot, motion)
    return bool((np.abs(torque) <= usable.upper[-robot.nv :] + np.array(robot.coulomb_friction)).all())


def _duration(logs: tuple[Log, ...]) -> float:
    seconds = float(np.mean([log.motion.t[-1] - log.motion.t[0] for log in logs]))
    return float(np.clip(round(seconds), _SHORTEST, _LONGEST))


def _told(
    diagnosis: Diagnosis, logs: tuple[Log, ...], groups: tuple[tuple[Hypothesis, ...], ...], trials: tuple[Trial, ...]
) -> Diagnosis:
    pairs = tuple(pair for group in groups for pair in _pairs(group))
    best = trials[0] if trials else None
    if best is None or not best.parts:
        return replace(diagnosis, notes=(*diagnosis.notes, nothing_parts(pairs)))
    parted = tuple(pair for pair, power in zip(pairs, best.power, strict=True) if power >= LEAST_POWER)
    rest = tuple(pair for pair in pairs if pair not in parted)
    effects = dict.fromkeys(
        (at.effect, at.joint) for pair in parted for one in (pair.one, pair.other) for at in one.effects
    )
    power = float(best.power[best.power >= LEAST_POWER].min())
    experiment = {
        "separates": [list(effect) for effect in effects],
        "reference": REFERENCE,
        "expected_power": power,
        "say": proposal_words(parted, best.candidate, best.mass, REFERENCE, power),
    }
    notes = (nothing_parts(rest),) if rest else ()
    return replace(
        diagnosis,
        next_experiment=experiment,
        next_motion=best.candidate.motion(min(logs[0].band.rate_hz, _RATE_HZ)),
        notes=(*diagnosis.notes, *notes),
    )


def _pairs(group: tuple[Hypothesis, ...]) -> tuple[Pair, ...]:
    return tuple(Pair(one, other) for one, other in combinations(group, 2))
