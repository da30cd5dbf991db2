"""From a diagnosis with rivals to the recording that parts them."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from identification.data.log import Log
from identification.diagnosis.model.terms import KnownEffect, Term
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.search.refinement import found_effects
from identification.diagnosis.search.search import Search
from identification.next_experiment.candidates import safe_limits
from identification.next_experiment.hypotheses import Hypothesis, hypotheses_of, union_of
from identification.next_experiment.laboratory import laboratory
from identification.next_experiment.proposal_words import nothing_parts, proposal_words
from identification.next_experiment.separation import LEAST_POWER, Pair, rivalry_of
from identification.next_experiment.trials import Trial, tried
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

REFERENCE = "next.csv"
# Findings whose rivals are to be parted, the largest first.
_FINDINGS = 3
# Length of a proposed recording [s]: that of those at hand, within these.
_SHORTEST, _LONGEST = 8.0, 20.0
# Rows per second of a reference: those of the recordings, no more than a controller's clock.
_RATE_HZ = 1000.0


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
        "say": proposal_words(parted, best, REFERENCE, power),
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
