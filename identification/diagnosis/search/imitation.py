"""Sums of a few effects that imitate a finding, where joints move along one line or in one sine.

There the torque of every joint is a function of one variable, and sums of laws imitate others, which a comparison with
single effects does not show. So a few effects are searched for that make the torque of a finding, while the sizes of
the other findings may change. In one sine this concerns loads, links and torque scales; friction shows there.
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
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.motion import Motion

# Most effects in a sum.
_MOST = 3
# Largest probability of a load, of links and of torque scales: sums of more laws than are tried may imitate them.
_UNCERTAIN = 0.85
# The same where the torque was computed and not measured: perhaps with the model of another robot.
_OF_A_MODEL = 0.5


def joints_on_lines(session: Session) -> frozenset[int]:
    """Joints that move along one line with others in all recordings, by their indices."""
    velocities = [log.motion.v[log.valid] for log in session.logs]
    return frozenset(row for line in lines_of(np.concatenate(velocities)) for row in line)


def is_inertial_or_scale(term: Term) -> bool:
    """True for loads, links and torque scales, whose columns contain all parts of the modelled torque."""
    return term.effect.inertial is not None or term.effect.scales_joint


def imitation_of(search: Search, chosen: frozenset[Term], term: Term) -> tuple[Term, ...] | None:
    """A few effects that imitate one to a tenth of its amplitude, while the others of a set may have any size.

    None if there are no such effects; an empty tuple where the others of the set do so by themselves.

    Args:
        search: Rivals, and their products.
        chosen: The set.
        term: One of it.
    """
    a, precision = search.problem.total_a, search.problem.precision
    columns = np.array(term.columns)
    theta = search.held_out_fit(chosen).theta[columns]
    energy = float(theta @ a[np.ix_(columns, columns)] @ theta)
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
        left, across = _unexplained(a, precision, columns, theta, by)
        if left < rules.SAME_CAUSE * energy:
            return taken
        if len(taken) == _MOST or not pool:
            return None
        gains = [_gain(a, precision, np.array(one.columns), by, across) for one in pool]
        taken = (*taken, pool.pop(int(np.argmax(gains))))
    return None


def beside_imitation(comparison: RivalComparison, imitation: tuple[Term, ...] | None) -> RivalComparison:
    """The comparison of a finding, with a sum of effects as a rival, both equally probable.

    Args:
        comparison: From the comparison with single rivals.
        imitation: Effects that make the same torque together; None if there are none.
    """
    if imitation is None:
        return comparison
    known = {frozenset(rival.effects) for rival in comparison.rivals}
    effects = tuple(EffectAt(one.effect.name, one.joint) for one in imitation)
    if frozenset(effects) in known:
        return comparison
    half = 0.5 * comparison.probability
    rivals = (*comparison.rivals, Rival(effects, half)) if effects else comparison.rivals
    ranked = tuple(sorted(rivals, key=lambda rival: -rival.probability))
    return replace(comparison, probability=half, rivals=ranked)


def on_a_line(comparison: RivalComparison, term: Term) -> RivalComparison:
    """The comparison where joints move along one line: loads, links and torque scales are never certain."""
    return _at_most(comparison, term, _UNCERTAIN)


def of_a_model(comparison: RivalComparison, term: Term) -> RivalComparison:
    """The comparison of a finding where the torque was computed from a weight by an unknown model."""
    return _at_most(comparison, term, _OF_A_MODEL)


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


def _at_most(comparison: RivalComparison, term: Term, most: float) -> RivalComparison:
    """A comparison with a probability of at most ``most`` if the finding is a load, links or a torque scale."""
    if not is_inertial_or_scale(term):
        return comparison
    return replace(comparison, probability=min(comparison.probability, most))


def _unexplained(
    a: Float[Array, "K K"],
    precision: Float[Array, " K"],
    columns: Int[Array, " k"],
    theta: Float[Array, " k"],
    by: Int[Array, " m"],
) -> tuple[float, Float[Array, " K"]]:
    """Squared torque of some columns that others leave, and the products of all columns with that residual."""
    target = a[:, columns] @ theta
    x = solve(a[np.ix_(by, by)] + np.diag(precision[by]), target[by])
    energy = float(theta @ target[columns])
    return energy - float(target[by] @ x), target - a[:, by] @ x


def _gain(
    a: Float[Array, "K K"],
    precision: Float[Array, " K"],
    columns: Int[Array, " k"],
    by: Int[Array, " m"],
    across: Float[Array, " K"],
) -> float:
    """Squared torque that further columns would explain of that residual."""
    inner = a[np.ix_(by, by)] + np.diag(precision[by])
    cross = a[np.ix_(by, columns)]
    own = a[np.ix_(columns, columns)] + np.diag(precision[columns]) - cross.T @ solve(inner, cross)
    return float(across[columns] @ solve(own, across[columns]))
