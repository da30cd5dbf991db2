"""What else makes the torque of a finding where joints move along one line, or in one sine: several effects together.

There the torque of every joint is a function of one variable, and sums of laws imitate others. A comparison of single
effects does not see that. So those few effects are looked for that make what a finding makes, beside the other findings
whose sizes may change with them. In one sine the same goes for what has columns of every motion; friction shows there.
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
from identification.diagnosis.search.claims import rows_of
from identification.diagnosis.search.containment import contains, possible
from identification.diagnosis.search.rival_sets import Standing
from identification.diagnosis.search.search import Search
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.motion import Motion

# Effects that imitate one together, at most.
_MOST = 3
# Probability of a load, of links and of torque scales, at most: sums of more laws than are tried imitate these.
_UNCERTAIN = 0.85
# The same where somebody computed the torque: the recording does not say whether from this robot or from another.
_OF_A_MODEL = 0.5


def along_lines(session: Session) -> frozenset[int]:
    """Joints that move along one line with others in all recordings, by their indices."""
    velocities = [log.motion.v[log.valid] for log in session.logs]
    return frozenset(row for line in lines_of(np.concatenate(velocities)) for row in line)


def of_every_motion(term: Term) -> bool:
    """True of an effect whose columns are made of all that a motion asks for: loads, links and torque scales."""
    return term.effect.inertial is not None or term.effect.scales_joint


def imitated_by(search: Search, chosen: frozenset[Term], term: Term) -> tuple[Term, ...] | None:
    """Effects that make the torque of one to a tenth of its amplitude, with the others of a set in any size.

    None if no few effects do; none of them where the others of the set do so by themselves.

    Args:
        search: Rivals, and their products.
        chosen: The set.
        term: One of it.
    """
    a, precision = search.problem.total_a, search.problem.precision
    columns = np.array(term.columns)
    theta = search.evaluate(chosen).theta[columns]
    energy = float(theta @ a[np.ix_(columns, columns)] @ theta)
    if energy <= 0.0:
        return None
    others = [column for other in ordered(chosen) if other is not term for column in other.columns]
    rows = rows_of(search.problem, term)
    pool = [
        other
        for other in search.terms
        if other.named
        and not other.shape
        and possible(chosen - {term}, other)
        and other.place != term.place
        and not contains(other, term)
        # A load and other causes together may be what free bodies take up; of a law of friction that is no news.
        and (term.effect.inertial == "free" or not contains(term, other))
        and not rows.isdisjoint(rows_of(search.problem, other))
    ]
    taken: tuple[Term, ...] = ()
    for _ in range(_MOST + 1):
        by = np.array(sorted({*others, *(column for one in taken for column in one.columns)}), dtype=int)
        left, across = _left(a, precision, columns, theta, by)
        if left < rules.SAME_CAUSE * energy:
            return taken
        if len(taken) == _MOST or not pool:
            return None
        gains = [_gain(a, precision, np.array(one.columns), by, across) for one in pool]
        taken = (*taken, pool.pop(int(np.argmax(gains))))
    return None


def beside_imitation(standing: Standing, imitation: tuple[Term, ...] | None) -> Standing:
    """The standing of a finding beside effects that make the same: each is as likely as the other.

    Args:
        standing: Compared with single rivals.
        imitation: Effects that make the same torque together; None: there are none.
    """
    if imitation is None:
        return standing
    known = {frozenset(rival.effects) for rival in standing.rivals}
    effects = tuple(EffectAt(one.effect.name, one.joint) for one in imitation)
    if frozenset(effects) in known:
        return standing
    half = 0.5 * standing.probability
    rivals = (*standing.rivals, Rival(effects, half)) if effects else standing.rivals
    ranked = tuple(sorted(rivals, key=lambda rival: -rival.probability))
    return replace(standing, probability=half, rivals=ranked)


def on_a_line(standing: Standing, term: Term) -> Standing:
    """The standing of a finding where joints move along one line: what has columns of every motion is not certain."""
    return _at_most(standing, term, _UNCERTAIN)


def of_a_model(standing: Standing, term: Term) -> Standing:
    """The standing of a finding where the torque was computed from a weight, by somebody's own model."""
    return _at_most(standing, term, _OF_A_MODEL)


def of_weights(session: Session) -> frozenset[int]:
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


def _at_most(standing: Standing, term: Term, most: float) -> Standing:
    """A standing that is no more probable than ``most`` if it is one of a load, of links or of a torque scale."""
    if not of_every_motion(term):
        return standing
    return replace(standing, probability=min(standing.probability, most))


def _left(
    a: Float[Array, "K K"],
    precision: Float[Array, " K"],
    columns: Int[Array, " k"],
    theta: Float[Array, " k"],
    by: Int[Array, " m"],
) -> tuple[float, Float[Array, " K"]]:
    """Squared torque that some columns leave of others, and the products of all columns with what they leave."""
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
    """Squared torque that further columns would take off what is left."""
    inner = a[np.ix_(by, by)] + np.diag(precision[by])
    cross = a[np.ix_(by, columns)]
    own = a[np.ix_(columns, columns)] + np.diag(precision[columns]) - cross.T @ solve(inner, cross)
    return float(across[columns] @ solve(own, across[columns]))
