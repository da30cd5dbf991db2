"""Effects that go with the motion, judged where the torque is far above the noise.

A disturbance that nobody records moves the joint, and the controller answers. The disturbance is what the model leaves.
The acceleration that it makes goes with it as too small an inertia would; the answer is in the recorded torque, and as
damping makes it, its rate goes with the disturbance as a delay of some ten milliseconds would on a soft joint. Where
the torque of the motion is many times what is left, there is no room for that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from identification.data.checks.one_line import is_one_sine
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.fewer_columns import columns_for
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import held_out_torque, residual_after, row_gaps
from identification.diagnosis.judge.judged_band import Judge, search_below
from identification.diagnosis.judge.shares import left_by
from identification.diagnosis.search.claims import asked
from identification.diagnosis.search.search import Search
from identification.engine.claims import GateResult
from identification.gates import moved_joints
from identification.gates.moved_joints import shown_above_noise, shown_by_motion
from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import power_density

# Samples of a spectrum's segment.
_SEGMENT = 256


def motion_results(loud: Search, there: Mapping[Term, Term], chosen: frozenset[Term]) -> dict[Term, GateResult]:
    """What the gate of motion says of those of some effects that go with the motion, see `loud_search`.

    Args:
        loud: A search where the torque of the motion is far above the noise.
        there: Each effect with its place there.
        chosen: Effects that are shown together.
    """
    motion = [term for term in ordered(chosen) if accelerates(term)]
    return {term: _in_motion(loud, _of(there, chosen), _of(there, chosen - {term})) for term in motion}


def accelerates(term: Term) -> bool:
    """True if an effect goes with the acceleration of the motion, as noise that moves a joint does."""
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
        if not _in_motion(loud, _of(there, every), _of(there, kept)).passed:
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


def noise_results(
    judge: Judge, search: Search, chosen: frozenset[Term], asked: Iterable[Term]
) -> dict[Term, GateResult]:
    """What the gate of noise says of effects that noise may make.

    The noise of the floor's upper end moves joints, which looks like an effect that goes with the motion, and leaves
    friction open where a joint turns about.

    Args:
        judge: Upper end of each joint's floor.
        search: Plain fits in the judged band.
        chosen: Effects that are shown.
        asked: Those of them that noise may make.
    """
    left, out = np.maximum(left_by(judge, search, chosen).rms(), 1e-300), {}
    for term in asked:
        without = left_by(judge, search, chosen - {term}).rms()
        out[term] = shown_above_noise((without / left) ** 2 - 1.0, without, judge.highest)
    return out


def noise_may_make(term: Term) -> bool:
    """True of effects that go with the motion, and of friction where a joint is slow."""
    return term.named and bool(term.effect.goes_with_motion or term.effect.acts_when_slow)


def _in_motion(loud: Search, chosen: frozenset[Term], without: frozenset[Term]) -> GateResult:
    """What the gate of motion says of effects: by their price, and by the scatter from block to block.

    What acts in few blocks scatters; it is there if the rules of the search would claim it.
    """
    rich, plain = loud.evaluate(chosen), loud.evaluate(without)
    gains = plain.loss - rich.loss
    held_out, in_sample = plain.total - rich.total, plain.objective - rich.objective
    price = loud.price_of(chosen) - loud.price_of(without)
    scatter = float(np.sqrt(len(gains)) * gains.std())
    return shown_by_motion(asked(loud, chosen, without)[-1], held_out, in_sample, scatter, price)


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
    """Frequency up to which the torque has many times the power of what is left [Hz].

    One sine has nothing below its line: what is quiet there is no end.
    """
    length = min(_SEGMENT, max(len(rest) // 4, 8), len(rest))
    f, noise = power_density(rest, rate_hz, length)
    _, power = power_density(torque, rate_hz, length)
    # The first bin is a constant, which a spectrum takes off.
    quiet = np.flatnonzero((power < moved_joints.MOVED_BY_NOISE * noise) & (f > 0.0))
    if is_one_sine(torque):
        quiet = quiet[quiet >= np.argmax(power)]
    return float(f[quiet[0]]) if len(quiet) else np.inf
