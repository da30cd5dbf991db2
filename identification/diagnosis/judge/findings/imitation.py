"""Searches for a few effects whose sum imitates a finding, if joints move along one line or in one sine.

In such motions the torque of each joint is a function of one variable, so that a sum of laws may imitate another law.
A comparison with single rivals does not show this. So a greedy search adds up to three effects whose sum makes the
torque of a finding, while the sizes of the other findings may change. In one sine only loads, links and torque scales
are tested, because friction can be identified there.
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
from identification.diagnosis.search.claims import rows_of_term
from identification.diagnosis.search.containment import can_join, contains
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.search import Search
from identification.engine.numerics.bounded import solve
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Largest number of effects in a sum.
_MOST_EFFECTS = 3
# Largest probability of a load, of links and of torque scales in such motions: sums of more effects may imitate them.
LARGEST_PROBABILITY = 0.85


def joints_on_lines(session: Session) -> frozenset[int]:
    """Indices of the joints that move along one line with other joints in all recordings."""
    velocities = [log.motion.v[log.valid] for log in session.logs]
    return frozenset(row for line in lines_of(np.concatenate(velocities)) for row in line)


def is_inertial_or_scale(term: Term) -> bool:
    """True for a load, wrong links or a torque scale: their columns contain all parts of the modelled torque."""
    return term.effect.inertial is not None or term.effect.scales_joint


def imitation_of(search: Search, chosen: frozenset[Term], term: Term) -> tuple[Term, ...] | None:
    """Effects whose sum makes the torque of a finding up to a tenth of its amplitude, with other findings of any size.

    Args:
        search: Rivals, and the products of their columns.
        chosen: A set of effects.
        term: The finding, one effect of the set.

    Returns:
        The effects; empty if the other effects of the set imitate the finding alone, and None if no sum imitates it.
    """
    a, precision = search.problem.total_a, search.problem.precision
    columns = list(term.columns)
    theta = search.held_out_fit(chosen).theta[columns]
    # Products of all columns with the torque of the finding, and its sum of squares.
    target = a[:, columns] @ theta
    energy = float(theta @ target[columns])
    if energy <= 0.0:
        return None
    others = [column for other in ordered(chosen) if other is not term for column in other.columns]
    rows = rows_of_term(search.problem, term)
    pool = [
        other
        for other in search.terms
        if other.named
        and not other.shape
        and can_join(chosen - {term}, other)
        and other.effect_joint != term.effect_joint
        and not contains(other, term)
        # Special cases of a law do not imitate it. But free inertial parameters may express a load and other causes.
        and (term.effect.inertial == "free" or not contains(term, other))
        and not rows.isdisjoint(rows_of_term(search.problem, other))
    ]
    taken: tuple[Term, ...] = ()
    for _ in range(_MOST_EFFECTS + 1):
        fitted = np.array(sorted({*others, *(column for one in taken for column in one.columns)}), dtype=int)
        inner = a[np.ix_(fitted, fitted)] + np.diag(precision[fitted])
        x = solve(inner, target[fitted])
        if energy - float(target[fitted] @ x) < rules.SAME_CAUSE * energy:
            return taken
        if len(taken) == _MOST_EFFECTS or not pool:
            break
        # Products of all columns with the part of the torque that is not imitated yet, and the gain of each further
        # effect: how much of that part it would explain.
        remaining, gains = target - a[:, fitted] @ x, []
        for one in pool:
            own = np.array(one.columns)
            cross = a[np.ix_(fitted, own)]
            square = a[np.ix_(own, own)] + np.diag(precision[own]) - cross.T @ solve(inner, cross)
            gains.append(float(remaining[own] @ solve(square, remaining[own])))
        taken = (*taken, pool.pop(int(np.argmax(gains))))
    return None


def with_imitation(comparison: RivalComparison, imitation: tuple[Term, ...] | None) -> RivalComparison:
    """The comparison of a finding, with a sum of effects as an equally probable rival.

    Args:
        comparison: Comparison with single rivals.
        imitation: Result of `imitation_of`.
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


def joints_with_unmodelled_forces(robot: Robot) -> frozenset[int]:
    """Indices of the joints on which forces may act that the robot's file states and the model leaves out."""
    passive = () if robot.chain is None else robot.chain.passive_names
    if not robot.unmodelled.isdisjoint(passive):
        return frozenset(range(robot.nv))
    return frozenset(k for k, joint in enumerate(robot.joint_names) if joint in robot.unmodelled)


def joints_with_computed_torque(session: Session) -> frozenset[int]:
    """Indices of the joints whose torque was computed from a weight, and not measured, in all recordings."""
    if session.robot.floating:  # the direction of gravity changes in the frame of the base
        return frozenset()
    from_weight = np.ones(session.robot.nv, dtype=bool)
    for log in session.logs:
        m, use = log.motion, log.valid_in_band
        # In the band, because accelerations of single samples are noise.
        t, q, v, a, tau = (log.band(x)[use] for x in (m.t, m.q, m.v, m.a, log.tau))
        from_weight &= computed_from_weight(session.robot, Motion(t, q, v, a), tau)
    return frozenset(np.flatnonzero(from_weight).tolist())
