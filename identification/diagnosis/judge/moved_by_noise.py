"""Effects that depend on the motion, tested at frequencies where the torque is far above the noise.

An unrecorded disturbance moves a joint, and the controller responds. The disturbance is then the residual of the model.
It is correlated with the acceleration that it causes, which looks like a wrong inertia. It is also correlated with the
rate of the recorded torque, because the damping of the controller responds to it, which looks like a delay of some ten
milliseconds on a soft joint. Such correlations are small where the torque of the motion is many times the residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.fewer_columns import columns_for
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import held_out_torque, residual_after, row_gaps
from identification.diagnosis.judge.judged_band import Judge, search_below
from identification.diagnosis.judge.shares import residual_sums_with
from identification.diagnosis.search.claims import gate_results
from identification.diagnosis.search.search import Search
from identification.engine.claims import GateResult
from identification.gates import moved_joints
from identification.gates.moved_joints import shown_by_motion
from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import power_density

# Samples in a segment of a power spectrum.
_SEGMENT = 256


def motion_results(strong: Search, terms: Mapping[Term, Term], chosen: frozenset[Term]) -> dict[Term, GateResult]:
    """Result of the gate `shown_by_motion` for each effect that depends on the acceleration.

    Args:
        strong: The search of `strong_motion_search`.
        terms: Term of each effect in that search.
        chosen: The set of effects that explains the recordings.
    """
    acceleration = [term for term in ordered(chosen) if depends_on_acceleration(term)]
    return {term: _motion_gate(strong, terms, chosen, chosen - {term}) for term in acceleration}


def depends_on_acceleration(term: Term) -> bool:
    """True if an effect depends on the acceleration, with which noise that moves a joint is correlated."""
    return term.effect.goes_with_motion == "acceleration"


def predictable_noise(
    judge: Judge, search: Search, kept: frozenset[Term], noise: Series, left: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Mean square of the part of each joint's noise that predictors can predict because it moves the joint, ``(nv,)``.

    It is zero for joints whose residual is not above their floor. For the others, all effects that depend on the motion
    of the joint are fitted. If they fail the gate `shown_by_motion`, what they explain is noise.

    Args:
        judge: Noise floor of each joint, without this part.
        search: Plain fits in the judged band.
        kept: Effects that passed the gates.
        noise: Noise of each log's torque.
        left: Root mean square of each joint's residual after these effects.
    """
    out, joints = np.zeros(len(left)), search.problem.session.robot.joint_names
    above = [row for row in range(len(left)) if left[row] > judge.highest[row]]
    if not above:
        return out
    with_motion = {row: kept | _motion_effects(search, joints[row]) for row in above}
    strong, terms = strong_motion_search(search, kept, frozenset().union(*with_motion.values()), noise)
    for row, more in with_motion.items():
        if not _motion_gate(strong, terms, more, kept).passed:
            less, least = (residual_sums_with(search, some).rms()[row] ** 2 for some in (kept, more))
            out[row] = max(less - least, 0.0)
    return np.minimum(out, largest_predictable_noise(judge))


def largest_predictable_noise(judge: Judge) -> Float[Array, " nv"]:
    """Largest mean square of the part of each joint's noise that predictors can predict, ``(nv,)``.

    The floor lacks this part, but a residual of `SENSOR_TIMES` times the floor is a gap whatever its cause.
    """
    return ((rules.SENSOR_TIMES * judge.floor) ** 2 - judge.highest**2).clip(min=0.0)


def _motion_effects(search: Search, joint: str) -> frozenset[Term]:
    """One effect of each kind that depends on the motion of a joint."""
    own = (term for term in search.terms if term.named and term.effect.goes_with_motion and term.joint == joint)
    # Of the shapes of an effect the first is taken.
    return frozenset({term.effect_joint: term for term in reversed([*own])}.values())


def noise_may_imitate(term: Term) -> bool:
    """True for an effect that noise may imitate.

    Its torque depends on the motion, or acts while a joint is slow or reverses, or is largest at high accelerations.
    The acceleration contains noise of the encoder, to which a controller responds with a torque. While a joint reverses
    its friction is uncertain, also where the model is right.
    """
    effect = term.effect
    return term.named and bool(effect.goes_with_motion or effect.acts_when_slow or effect.regime == "high_acceleration")


def _motion_gate(
    strong: Search, terms: Mapping[Term, Term], chosen: frozenset[Term], without: frozenset[Term]
) -> GateResult:
    """Result of the gate `shown_by_motion` for the effects that ``without`` lacks.

    The gain of an effect that acts in few blocks scatters; such an effect passes if the gates of the search accept it.
    """
    chosen, without = (frozenset(terms[term] for term in some) for some in (chosen, without))
    rich, plain = strong.held_out_fit(chosen), strong.held_out_fit(without)
    gains = plain.loss - rich.loss
    held_out, in_sample = plain.total - rich.total, plain.objective - rich.objective
    price = strong.price_of(chosen) - strong.price_of(without)
    scatter = float(np.sqrt(len(gains)) * gains.std())
    return shown_by_motion(gate_results(strong, chosen, without)[-1], held_out, in_sample, scatter, price)


def strong_motion_search(
    search: Search, chosen: frozenset[Term], tested: frozenset[Term], noise: Series
) -> tuple[Search, dict[Term, Term]]:
    """A search over the frequencies at which the torque of each joint is far above the noise.

    It has the columns of few effects only: with those of all rivals it would need as much memory as ``search``.

    Args:
        search: Plain fits in the judged band.
        chosen: The effects that explain the recordings; their residual counts as noise.
        tested: Effects to be tested, which get columns.
        noise: Noise of each log's torque.

    Returns:
        The search, and the term in it of each tested effect.
    """
    problem, columns, session = search.problem, search.problem.columns, search.problem.session
    residual = residual_after(problem, held_out_torque(problem, chosen, search.held_out_fit(chosen)))
    rates = [log.band.output_rate_hz for log in session.logs]
    edges = np.array(
        [
            min(
                _strong_up_to(np.where(use[:, row], rest[:, row], 0.0), torque[:, row], rate)
                for use, rest, torque, rate in zip(columns.usable, residual, columns.model_torque, rates, strict=True)
            )
            for row in range(len(columns.rows))
        ]
    )
    few, terms = columns_for(columns, tested)
    strong = search_below(search, few, noise, np.minimum(edges, session.cutoff_hz))
    # Weights and band differ from those of ``search``, and so does the gap of each row.
    return replace(strong, rows=row_gaps(strong.problem, strong.held_out_fit(frozenset()))), terms


def _strong_up_to(rest: Float[Array, " n"], torque: Float[Array, " n"], rate_hz: float) -> float:
    """Frequency [Hz] up to which the torque has `MOVED_BY_NOISE` times the power of the residual; may be infinite.

    Frequencies below that of the largest power are not tested: below a periodic motion there is no motion.
    """
    length = min(_SEGMENT, max(len(rest) // 4, 8), len(rest))
    f, noise = power_density(rest, rate_hz, length)
    _, power = power_density(torque, rate_hz, length)
    # The first bin is the mean, which the spectrum removes.
    weak = (power < moved_joints.MOVED_BY_NOISE * noise) & (f > 0.0)
    weak[: np.argmax(power)] = False
    return float(min(f[weak], default=np.inf))
