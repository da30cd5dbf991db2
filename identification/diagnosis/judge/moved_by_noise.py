"""Effects that go with the motion, judged where the torque is far above the noise.

A disturbance that nobody records moves the joint, and the controller answers. The disturbance is what the model leaves.
The acceleration that it makes goes with it as too small an inertia would; the answer is in the recorded torque, and as
damping makes it, its rate goes with the disturbance as a delay of some ten milliseconds would on a soft joint. Where
the torque of the motion is many times what is left, there is no room for that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.fit.gap import held_out_torque, residual_after
from identification.diagnosis.judge.judged_band import Judge, search_below
from identification.diagnosis.judge.shares import left_by
from identification.diagnosis.model.fewer_columns import columns_for
from identification.diagnosis.model.session import Series
from identification.diagnosis.model.terms import Term, ordered
from identification.diagnosis.search.row_gaps import row_gaps
from identification.diagnosis.search.search import Search, claimed
from phantom_dyn.array_types import Float
from phantom_dyn.signals.spectra import power_density

Array = np.ndarray

# Samples of a spectrum's segment.
_SEGMENT = 256


def shown_by_motion(search: Search, chosen: frozenset[Term], noise: Series) -> frozenset[Term]:
    """The chosen effects without those that go with the motion and do not show where it is far above the noise.

    Args:
        search: Plain fits in the judged band.
        chosen: Effects that explain the recordings together.
        noise: Of each log's torque.
    """
    if not any(_accelerates(term) for term in chosen):
        return chosen
    loud, there = loud_search(search, chosen, chosen, noise)
    while True:
        motion = [term for term in ordered(chosen) if _accelerates(term)]
        doubtful = [term for term in motion if not _shows(loud, _of(there, chosen), _of(there, chosen - {term}))]
        if not doubtful:
            return chosen
        chosen = chosen - {min(doubtful, key=lambda term: loud.score(_of(there, chosen - {term})))}


def _accelerates(term: Term) -> bool:
    return term.effect.goes_with_motion == "acceleration"


def foreseen_noise(
    judge: Judge, search: Search, kept: frozenset[Term], noise: Series, left: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Mean square of the noise of each joint that predictors foresee because it moves the joint.

    Only of joints that have more left than their floor allows: there all effects that go with the motion of the joint
    are tried. If they do not show where the torque is far above the noise, what they take off is noise.

    Args:
        judge: Noise floor of each joint, without that.
        search: Plain fits in the judged band.
        kept: Effects that are shown.
        noise: Of each log's torque.
        left: What the effects leave of each joint, root mean square.
    """
    out, joints = np.zeros(len(left)), search.problem.session.robot.joint_names
    above = [row for row in range(len(left)) if left[row] > judge.highest[row]]
    if not above:
        return out
    with_motion = {row: kept | _going_with_motion(search, joints[row]) for row in above}
    loud, there = loud_search(search, kept, frozenset().union(*with_motion.values()), noise)
    for row, every in with_motion.items():
        if not _shows(loud, _of(there, every), _of(there, kept)):
            squares = [left_by(judge, search, some).rms()[row] ** 2 for some in (kept, every)]
            out[row] = max(squares[0] - squares[1], 0.0)
    # What foresees most of it leaves a floor that is far too low; several times the floor is a gap all the same.
    return np.minimum(out, ((rules.SENSOR_TIMES * judge.floor) ** 2 - judge.highest**2).clip(min=0.0))


def _going_with_motion(search: Search, joint: str) -> frozenset[Term]:
    """One effect of each kind that goes with the motion of a joint."""
    alike: dict[tuple[str, str | None], Term] = {}
    for term in search.terms:
        if term.named and term.effect.goes_with_motion and term.joint == joint:
            alike.setdefault(term.place, term)
    return frozenset(alike.values())


def _of(there: Mapping[Term, Term], chosen: frozenset[Term]) -> frozenset[Term]:
    """The same effects among fewer columns."""
    return frozenset(there[term] for term in chosen)


def least_above_noise(judge: Judge, search: Search, chosen: frozenset[Term]) -> Term | None:
    """An effect that noise may make and without which no joint has more left than its noise; None if there is none.

    The noise of the floor's upper end moves joints, which looks like an effect that goes with the motion, and leaves
    friction open where a joint turns about. Of several such effects the one that helps least.

    Args:
        judge: Upper end of each joint's floor.
        search: Plain fits in the judged band.
        chosen: Effects that are shown.
    """
    left, helps = left_by(judge, search, chosen).rms(), {}
    for term in ordered(chosen):
        if not (term.named and (term.effect.goes_with_motion or term.effect.acts_when_slow)):
            continue
        without = left_by(judge, search, chosen - {term}).rms()
        growth = (without / np.maximum(left, 1e-300)) ** 2 - 1.0
        if not np.any((growth > rules.VISIBLE_GROWTH) & (without > judge.highest)):
            helps[term] = float(growth.max())
    return min(helps, key=lambda term: helps[term], default=None)


def _shows(loud: Search, chosen: frozenset[Term], without: frozenset[Term]) -> bool:
    """True if effects lower the held-out loss by more than their price and than its scatter from block to block.

    What acts in few blocks scatters; it is there if the rules of the search would claim it.
    """
    if claimed(loud, chosen, without):
        return True
    rich, plain = loud.evaluate(chosen), loud.evaluate(without)
    gains = plain.loss - rich.loss
    held_out, in_sample = plain.total - rich.total, plain.objective - rich.objective
    price = loud.price_of(chosen) - loud.price_of(without)
    scatter = float(np.sqrt(len(gains)) * gains.std())
    # In sample a gain can only be larger, unless chance has made the few held-out blocks agree.
    return held_out > rules.SIGNIFICANT_ERRORS * scatter and min(held_out, in_sample) > price


def loud_search(
    search: Search, chosen: frozenset[Term], asked: frozenset[Term], noise: Series
) -> tuple[Search, dict[Term, Term]]:
    """A search by what lies below the frequency up to which the torque of each joint is far above the noise.

    It holds the columns of few effects: with those of all rivals it would take as much memory as the search itself.

    Args:
        search: Plain fits in the judged band.
        chosen: What explains the recordings; what it leaves is noise here.
        asked: Effects that are to be judged by it.
        noise: Of each log's torque.

    Returns:
        The search, and each of these effects with its place there.
    """
    problem, session = search.problem, search.problem.session
    columns = problem.columns
    left = residual_after(problem, held_out_torque(problem, chosen, search.evaluate(chosen)))
    rates = [log.band.rate_hz / log.band.step for log in session.logs]
    edges = np.array(
        [
            min(
                _loud_until(np.where(use[:, row], rest[:, row], 0.0), torque[:, row], rate)
                for use, rest, torque, rate in zip(columns.usable, left, columns.model_torque, rates, strict=True)
            )
            for row in range(len(columns.rows))
        ]
    )
    few, there = columns_for(columns, asked)
    loud = search_below(search, few, noise, np.minimum(edges, session.cutoff_hz))
    # Squares count by other weights here, and in a narrower band.
    return replace(loud, rows=row_gaps(loud.problem, loud.evaluate(frozenset()))), there


def _loud_until(rest: Float[Array, " n"], torque: Float[Array, " n"], rate_hz: float) -> float:
    """Frequency up to which the torque has many times the power of what is left [Hz]."""
    length = min(_SEGMENT, max(len(rest) // 4, 8), len(rest))
    f, noise = power_density(rest, rate_hz, length)
    _, power = power_density(torque, rate_hz, length)
    # The first bin is a constant, which a spectrum takes off.
    quiet = np.flatnonzero((power < rules.MOVED_BY_NOISE * noise) & (f > 0.0))
    return float(f[quiet[0]]) if len(quiet) else np.inf
