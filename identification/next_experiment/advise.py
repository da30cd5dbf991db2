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
from identification.next_experiment.candidates import Candidate, candidates
from identification.next_experiment.hypotheses import Hypothesis, hypotheses_of, union_of
from identification.next_experiment.known_mass import SHARES, KnownMass, carried, known_mass
from identification.next_experiment.products import Laboratory, laboratory
from identification.next_experiment.propose import LEAST_POWER, Pair, Rivalry, powers, rivalry_of
from identification.next_experiment.safe import safe_limits
from identification.next_experiment.say import nothing_parts, proposal_words
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.robot import Robot

Array = np.ndarray

REFERENCE = "next.csv"
# Findings whose rivals are to be parted, the largest first.
_FINDINGS = 3
# Motions that are tried: as many as take a second or two.
_WORK, _FEWEST, _MOST = 120, 12, 40
# So many of the best ones that can be made with a known mass are tried with it too.
_LOADED = 3
_SEED = 20260109
# Length of a proposed recording [s]: that of those at hand, within these.
_SHORTEST, _LONGEST = 8.0, 20.0
# Rows per second of a reference: those of the recordings, no more than a controller's clock.
_RATE_HZ = 1000.0
# Power above which a further difference counts by its size.
_SURE = 0.995


@dataclass(frozen=True)
class Trial:
    """One motion, and how well it would part each pair.

    Attributes:
        candidate: The motion.
        mass: Carried along it; None for nothing.
        power: Probability that each pair is parted.
        gain: Squared distance of each pair.
        weight: How much each pair matters: how likely it is that one of the two is true and the other taken for it.
    """

    candidate: Candidate
    mass: KnownMass | None
    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    weight: Float[Array, " p"]

    @property
    def parts(self) -> float:
        """Weight of the pairs that it parts."""
        return float(self.weight[self.power >= LEAST_POWER].sum())

    @property
    def worth(self) -> tuple[float, float, float]:
        """What it parts, the least certain of these pairs, and its squared distance: the larger the better."""
        parted = self.power >= LEAST_POWER
        if not parted.any():
            return (0.0, float(self.power.max(initial=0.0)), 0.0)
        return (self.parts, min(float(self.power[parted].min()), _SURE), float(self.gain[parted].min()))


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
        chosen: The effects.
        noise: Of the torque, for each log.
        cutoff_hz: Edge of the judged band.
        known: Effects that belong to the given model already.
    """
    started = time.perf_counter()
    told = {(finding.effect, finding.joint) for finding in diagnosis.findings}
    chosen = frozenset(term for term in chosen if not term.named or term.place in told)
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
    trials = [
        judged(candidate, None, robot, lab, rivalries)
        for candidate in candidates(robot, limits, duration=duration, count=count, rng=rng)
    ]
    trials.sort(key=lambda trial: trial.worth, reverse=True)
    if not trials or (trials[0].power >= LEAST_POWER).all():
        return tuple(trials)
    carrying = (loaded_trial(trial.candidate, robot, limits, lab, rivalries) for trial in trials)
    with_mass = tuple(islice((trial for trial in carrying if trial is not None), _LOADED))
    # A mass is a burden: it has to part more than the best motion without one does.
    more = [trial for trial in with_mass if trial.parts > trials[0].parts]
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
    chance, apart = zip(*(powers(rivalry, planned) for rivalry in rivalries), strict=True)
    weight = [pair.weight for rivalry in rivalries for pair in rivalry.pairs]
    return Trial(candidate, mass, np.concatenate(chance), np.concatenate(apart), np.array(weight))


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
    if best is None or best.parts == 0.0:
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
