"""Sums of a few effects that imitate a finding, where joints move along one line or in one sine.

There the torque of every joint is a function of one variable, and a sum of laws may imitate another law. A comparison
with single effects does not show this. So a search looks for a few effects that together make the torque of a finding,
while the sizes of the other findings may change. In one sine this concerns loads, links and torque scales: friction can
be identified there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.one_line import lines_of
from identification.data.checks.torques.weight_and_friction import computed_from_weight
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.claims import rows_touched_by
from identification.diagnosis.search.containment import can_join, contains
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.search import Search
from identification.engine.numerics.bounded import solve
from phantom_dyn.motion import Motion

# Most effects in a sum.
_MOST = 3
# Largest probability of a load, of links and of torque scales: sums of more laws than are tried may imitate them.
UNCERTAIN = 0.85
# The same where the torque was computed and not measured: perhaps with the model of another robot.
OF_A_MODEL = 0.5


def joints_on_lines(session: Session) -> frozenset[int]:
    """Joints that move along one line with others in all recordings, by their indices."""
    velocities = [log.motion.v[log.valid] for log in session.logs]
    return frozenset(row for line in lines_of(np.concatenate(velocities)) for row in line)


def is_inertial_or_scale(term: Term) -> bool:
    """True for a load, wrong links or a torque scale: their columns contain all parts of the modelled torque."""
    return term.effect.inertial is not None or term.effect.scales_joint


def imitation_of(search: Search, chosen: frozenset[Term], term: Term) -> tuple[Term, ...] | None:
    """A few effects that imitate one to a tenth of its amplitude, while the others of a set may have any size.

    None if there are no such effects; an empty tuple if the others of the set imitate it without further effects.

    Args:
        search: Rivals, and their products.
        chosen: The set.
        term: One of it.
    """
    a, precision = search.problem.total_a, search.problem.precision
    columns = list(term.columns)
    theta = search.held_out_fit(chosen).theta[columns]
    target = a[:, columns] @ theta
    energy = float(theta @ target[columns])
    if energy <= 0.0:
        return None
    others = [column for other in ordered(chosen) if other is not term for column in other.columns]
    rows = rows_touched_by(search.problem, term)
    pool = [
        other
        for other in search.terms
        if other.named
        and not other.shape
        and can_join(chosen - {term}, other)
        and other.effect_joint != term.effect_joint
        and not contains(other, term)
        # Sums with parts of a law are no rivals of that law; but free bodies may stand for a load and other causes.
        and (term.effect.inertial == "free" or not contains(term, other))
        and not rows.isdisjoint(rows_touched_by(search.problem, other))
    ]
    taken: tuple[Term, ...] = ()
    for _ in range(_MOST + 1):
        by = np.array(sorted({*others, *(column for one in taken for column in one.columns)}), dtype=int)
        inner = a[np.ix_(by, by)] + np.diag(precision[by])
        x = solve(inner, target[by])
        if energy - float(target[by] @ x) < rules.SAME_CAUSE * energy:
            return taken
        if len(taken) == _MOST or not pool:
            break
        # Products of all columns with the torque that is not yet imitated, and the part of it that each rival explains.
        left, gains = target - a[:, by] @ x, []
        for own in (np.array(one.columns) for one in pool):
            cross = a[np.ix_(by, own)]
            square = a[np.ix_(own, own)] + np.diag(precision[own]) - cross.T @ solve(inner, cross)
            gains.append(float(left[own] @ solve(square, left[own])))
        taken = (*taken, pool.pop(int(np.argmax(gains))))
    return None


def beside_imitation(comparison: RivalComparison, imitation: tuple[Term, ...] | None) -> RivalComparison:
    """The comparison of a finding, with a sum of effects as an equally probable rival.

    Args:
        comparison: Comparison with single rivals.
        imitation: Effects that make the same torque together; None if there are none.
    """
    effects = tuple(EffectAt(one.effect.name, one.joint) for one in imitation or ())
    if imitation is None or frozenset(effects) in {frozenset(rival.effects) for rival in comparison.rivals}:
        return comparison
    half = 0.5 * comparison.probability
    rivals = (*comparison.rivals, Rival(effects, half)) if effects else comparison.rivals
    ranked = tuple(sorted(rivals, key=lambda rival: -rival.probability))
    return replace(comparison, probability=half, rivals=ranked)


def with_limit(comparison: RivalComparison, term: Term, most: float) -> RivalComparison:
    """The comparison, with a probability of at most ``most`` for a load, wrong links or a torque scale."""
    limit = most if is_inertial_or_scale(term) else np.inf
    return replace(comparison, probability=min(comparison.probability, limit))


def joints_with_computed_torque(session: Session) -> frozenset[int]:
    """Joints whose torque was computed from a weight in all recordings, by their indices."""
    if session.robot.floating:  # under which gravity turns
        return frozenset()
    from_weight = np.ones(session.robot.nv, dtype=bool)
    for log in session.logs:
        m, use = log.motion, log.valid_in_band
        # Accelerations of single samples are noise.
        t, q, v, a, tau = (log.band(x)[use] for x in (m.t, m.q, m.v, m.a, log.tau))
        from_weight &= computed_from_weight(session.robot, Motion(t, q, v, a), tau)
    return frozenset(np.flatnonzero(from_weight).tolist())
