"""Proposes the recording that separates the rivals of a diagnosis."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from identification.data.log import Log
from identification.data.signals import shortest_recording
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.result import Finding
from identification.diagnosis.search.refinement import found_effects
from identification.next_experiment.candidates import safe_limits
from identification.next_experiment.hypotheses import Hypothesis, hypotheses_of, union_of, with_all_findings
from identification.next_experiment.laboratory import laboratory
from identification.next_experiment.proposal import Proposal, not_separated, proposal_words
from identification.next_experiment.separation import Pair, rivalry_of
from identification.next_experiment.trials import Trial, ranked_trials
from identification.notes import Code, Note
from phantom_dyn.errors import ChainError, ParameterError, RobotError

REFERENCE = "next.csv"
# Findings whose rivals are to be separated, the largest first.
_FINDINGS = 3
# Length of a proposed recording [s]: that of those at hand, within these.
_SHORTEST, _LONGEST = 8.0, 20.0
# Rows per second of a reference: those of the recordings, no more than a controller's clock.
_RATE_HZ = 1000.0


def proposed(explanation: Explanation, findings: tuple[Finding, ...]) -> Proposal:
    """The recording to make next, where a finding has rivals that a motion can separate.

    Args:
        explanation: All effects that the search has found, those too that are not shown.
        findings: What is shown.
    """
    chosen = with_all_findings(explanation.search, explanation.chosen, findings)
    search = explanation.search.of(chosen)
    session = search.problem.session
    groups = tuple(group for finding in findings if (group := hypotheses_of(search, chosen, finding)))
    groups = groups[:_FINDINGS]
    if not groups:
        return Proposal()
    found = found_effects(search.evaluate(chosen), chosen)
    union = union_of(tuple(one for group in groups for one in group))
    lab = laboratory(search.problem, explanation.noise, union, found)
    try:
        limits = safe_limits(session.robot, session.logs)
        trials = ranked_trials(session.robot, limits, lab, rivalry_of(search, groups), length_of(session.logs))
    except (RobotError, ParameterError, ChainError) as problem:
        return Proposal(notes=(Note(Code.NO_EXPERIMENT, None, {"problem": str(problem)}),))
    except np.linalg.LinAlgError:
        return Proposal(notes=(Note(Code.NO_EXPERIMENT),))
    return _proposal(min(session.logs[0].band.rate_hz, _RATE_HZ), groups, trials)


def length_of(logs: tuple[Log, ...]) -> float:
    """Length of a recording to be proposed [s]: that of those at hand, neither very short nor very long.

    It is long enough for their band, however slowly they are sampled.
    """
    seconds = float(np.mean([log.motion.t[-1] - log.motion.t[0] for log in logs]))
    fewest = max(shortest_recording(log.band) for log in logs)
    return max(float(np.clip(round(seconds), _SHORTEST, _LONGEST)), fewest)


def _proposal(rate_hz: float, groups: tuple[tuple[Hypothesis, ...], ...], trials: tuple[Trial, ...]) -> Proposal:
    pairs = tuple(pair for group in groups for pair in _pairs(group))
    best = trials[0] if trials else None
    if best is None or not best.separates:
        return Proposal(notes=(not_separated(pairs),))
    separated = tuple(pair for pair, power in zip(pairs, best.power, strict=True) if power >= rules.SEPARATED)
    left = tuple(pair for pair in pairs if pair not in separated)
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
    return Proposal(experiment, best.candidate.motion(rate_hz), (not_separated(left),) if left else ())


def _pairs(group: tuple[Hypothesis, ...]) -> tuple[Pair, ...]:
    return tuple(Pair(one, other) for one, other in combinations(group, 2))
