"""Tests effects that depend on the motion at frequencies where the torque is far above the noise.

A disturbance that is not recorded moves a joint, and is the residual of a correct model. This residual is correlated
with the acceleration that the disturbance causes, which looks like a wrong inertia. It is also correlated with the rate
of change of the drive torque by which the controller damps the motion, which looks like a delay (some ten milliseconds
on a soft joint). Both correlations are small at frequencies where the torque of the motion is many times as large as
the residual.
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
from identification.diagnosis.judge.judged_band import JudgedBand, search_below
from identification.diagnosis.judge.shares import residual_sums_with
from identification.diagnosis.search.claims import gate_results
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search
from identification.engine.claims import GateResult
from identification.gates import moved_joints
from identification.gates.moved_joints import shown_by_motion
from phantom_dyn.array_types import Array, Float
from phantom_dyn.signals.spectra import power_density

# Number of samples in a segment of a power spectrum.
_SEGMENT = 256


def motion_results(strong: Search, terms: Mapping[Term, Term], chosen: frozenset[Term]) -> dict[Term, GateResult]:
    """Result of the gate `shown_by_motion` for each effect that depends on the acceleration.

    Args:
        strong: Search of `strong_motion_search`.
        terms: For each effect, its term in the search ``strong``.
        chosen: The set of effects that explains the recordings.
    """
    acceleration = [term for term in ordered(chosen) if depends_on_acceleration(term)]
    return {term: _motion_gate(strong, terms, chosen, chosen - {term}) for term in acceleration}


def depends_on_acceleration(term: Term) -> bool:
    """True if an effect depends on the acceleration, which is correlated with noise that moves a joint."""
    return term.effect.goes_with_motion == "acceleration"


def predictable_noise(
    judged: JudgedBand, search: Search, chosen: frozenset[Term], noise: Series, sizes: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Mean square of the predictable part of each joint's noise, ``(nv,)``: noise that moves the joint is predictable.

    For each joint whose residual is above its floor, all effects that depend on the motion of the joint are fitted. If
    they fail the gate `shown_by_motion`, the part of the residual that they explain is noise. For other joints the
    result is zero.

    Args:
        judged: Noise floor of each joint, without the predictable part.
        search: Plain fits in the judged band.
        chosen: Effects that passed the gates.
        noise: Noise of each log's torque.
        sizes: Root mean square of each joint's residual with these effects in the model, ``(nv,)``.
    """
    out, joints = np.zeros(len(sizes)), search.problem.session.robot.joint_names
    above = [row for row in range(len(sizes)) if sizes[row] > judged.highest[row]]
    if not above:
        return out
    with_motion = {row: chosen | _motion_effects(search, joints[row]) for row in above}
    strong, terms = strong_motion_search(search, chosen, frozenset().union(*with_motion.values()), noise)
    for row, more in with_motion.items():
        if not _motion_gate(strong, terms, more, chosen).passed:
            square, square_with_motion = (residual_sums_with(search, some).rms()[row] ** 2 for some in (chosen, more))
            out[row] = max(square - square_with_motion, 0.0)
    return np.minimum(out, largest_predictable_noise(judged))


def largest_predictable_noise(judged: JudgedBand) -> Float[Array, " nv"]:
    """Largest mean square of the predictable part of each joint's noise, which the floor does not contain, ``(nv,)``.

    It is limited because a residual above `SENSOR_TIMES` times the floor is a gap, whatever its cause.
    """
    return ((rules.SENSOR_TIMES * judged.floor) ** 2 - judged.highest**2).clip(min=0.0)


def _motion_effects(search: Search, joint: str) -> frozenset[Term]:
    """One effect of each kind that depends on the motion of a joint."""
    first_shapes: dict[EffectJoint, Term] = {}
    for term in search.terms:
        if term.named and term.effect.goes_with_motion and term.joint == joint:
            first_shapes.setdefault(term.effect_joint, term)
    return frozenset(first_shapes.values())


def noise_may_imitate(term: Term) -> bool:
    """True for an effect that noise may imitate.

    Such an effect depends on the motion, acts while a joint is slow or reverses, or is largest at high accelerations.
    The reasons: the measured acceleration contains noise of the encoder, to which a controller responds with a torque.
    And the friction of a joint that reverses is uncertain, also if the model is correct.
    """
    effect = term.effect
    return term.named and bool(effect.goes_with_motion or effect.acts_when_slow or effect.regime == "high_acceleration")


def _motion_gate(
    strong: Search, terms: Mapping[Term, Term], chosen: frozenset[Term], without: frozenset[Term]
) -> GateResult:
    """Result of the gate `shown_by_motion` for the effects of ``chosen`` that are not in ``without``."""
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
    """A search with fits to the frequencies at which the torque of each joint is far above the noise.

    It contains only the effects to be tested. With all rivals it would need as much memory as ``search``.

    Args:
        search: Plain fits in the judged band.
        chosen: The effects that explain the recordings. The residual that remains with them counts as noise.
        tested: Effects to be tested.
        noise: Noise of each log's torque.

    Returns:
        The search, and for each tested effect its term in the search.
    """
    problem, columns, session = search.problem, search.problem.columns, search.problem.session
    residual = residual_after(problem, held_out_torque(problem, chosen, search.held_out_fit(chosen)))
    rates = [log.band.output_rate_hz for log in session.logs]
    edges = np.array(
        [
            min(
                _strong_up_to(np.where(use[:, row], own[:, row], 0.0), torque[:, row], rate)
                for use, own, torque, rate in zip(columns.usable, residual, columns.model_torque, rates, strict=True)
            )
            for row in range(len(columns.rows))
        ]
    )
    few, terms = columns_for(columns, tested)
    strong = search_below(search, few, noise, np.minimum(edges, session.cutoff_hz))
    # The gap of each row is computed again, because weights and band differ from those of ``search``.
    return replace(strong, gaps=row_gaps(strong.problem, strong.held_out_fit(frozenset()))), terms


def _strong_up_to(residual: Float[Array, " n"], torque: Float[Array, " n"], rate_hz: float) -> float:
    """Frequency [Hz] up to which the torque has `MOVED_BY_NOISE` times the power of the residual; may be infinite.

    The ratio is not tested at frequencies below the largest power of the torque, because a periodic motion has little
    power below its frequency.
    """
    length = min(_SEGMENT, max(len(residual) // 4, 8), len(residual))
    f, noise = power_density(residual, rate_hz, length)
    _, power = power_density(torque, rate_hz, length)
    # The first bin is left out: it is the mean, which the spectrum removes.
    weak = (power < moved_joints.MOVED_BY_NOISE * noise) & (f > 0.0)
    weak[: np.argmax(power)] = False
    return float(min(f[weak], default=np.inf))
