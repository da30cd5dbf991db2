"""The effects that explain recordings: the search for effects and the estimate of noise, repeated until both agree."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import length_hint

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.column_variants import columns_at_readings
from identification.diagnosis.columns.fewer_columns import columns_for
from identification.diagnosis.columns.residual_columns import Columns, FitPoint, build_columns
from identification.diagnosis.columns.resonances import resonances
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.columns.terms import FoundEffect, Term
from identification.diagnosis.fit.gap import RowGaps, held_out_torque, residual_after, row_gaps
from identification.diagnosis.fit.problem import set_up
from identification.diagnosis.noise.chance import null_threshold
from identification.diagnosis.noise.encoder_noise import (
    CoarseJoint,
    at_least_encoder_noise,
    coarse_joints,
    coarsest_steps,
    simulated_recordings,
    spurious_gains,
)
from identification.diagnosis.noise.noise_floor import (
    estimate_noise,
    noise_floor,
    noise_without_remainder,
    smaller_noise,
    smaller_noise_in_band,
    weights_of,
)
from identification.diagnosis.noise.sensor_floor import sensed_noise
from identification.diagnosis.noise.whitening import at_least_sensor_noise, whitened, whitening_of
from identification.diagnosis.search.claims import gate_results, passes_gates
from identification.diagnosis.search.fits import FitLimitReached
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.refinement import (
    found_effects,
    matching_terms,
    needs_refinement,
    runners_up,
    same_points,
)
from identification.diagnosis.search.rival_sets import with_leading_rivals
from identification.diagnosis.search.search import Search, Threshold, most_fits, set_up_search
from identification.diagnosis.search.stepwise import best_below_threshold, stepwise_search
from identification.gates import above_chance
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Float

# Largest number of searches after the first. Each linearises the laws about the result of the search before it.
_REFINEMENTS = 3
# Largest number of repetitions of a fit with weights from its own residual, without another search.
_WEIGHED_AGAIN = 2
# Largest number of effects that are tested although they gain less than the threshold of chance.
_PROBATIONS = 3


@dataclass(frozen=True)
class Explanation:
    """Result of the search: the chosen effects and the noise that they were scored against.

    Attributes:
        search: All candidate effects of the session, and the scores of sets of them.
        chosen: The effects that explain the recordings.
        noise: Residual of each log's torque after these effects and flexible fits.
        in_band: The same residual after the fits that predict most in the judged band; empty if not computed.
        coarse: Encoders that are coarser than stated, or than those of other joints.
        encoders: Torque that the noise of the encoders makes in the judged band, root mean square, ``(nv,)``; None if
            not computed.
        fits: Number of sets of effects that the searches fitted.
        endless: True if the searches were stopped because they made too many fits. Then no effect is chosen.
    """

    search: Search
    chosen: frozenset[Term]
    noise: Series
    in_band: Series = ()
    coarse: tuple[CoarseJoint, ...] = ()
    encoders: Float[Array, " nv"] | None = None
    fits: int = 0
    endless: bool = False


def explanation_of(session: Session, progress: Progress = lambda _: None) -> Explanation:
    """The effects that explain the recordings of a session, by a stepwise search with held-out blocks.

    After each search, nonlinear laws are linearised again about its result, and the noise is estimated again from its
    residual. The search is stopped if it replaces one set by another without an end. That happens if the cause is not
    in the catalogue: many sets explain a part of its torque, and none explains all of it.

    Args:
        session: Robot, logs, blocks.
        progress: Receives the stages of the diagnosis.
    """
    most = most_fits(session.robot.nv)
    # The memory of the stopped search is freed only after the block that handles its exception.
    with suppress(FitLimitReached):
        return _explanation_of(session, progress, iter(range(most)))
    return replace(_explanation_of(session, progress, None), fits=most, endless=True)


def _explanation_of(session: Session, progress: Progress, allowed: Iterator[int] | None) -> Explanation:
    """The effects that explain the recordings, by a limited number of fits.

    Args:
        session: Robot, logs, blocks.
        progress: Receives the stages of the diagnosis.
        allowed: Yields one item for each allowed fit; None: no effect is searched for.

    Raises:
        FitLimitReached: At the first fit that is not allowed.
    """
    progress(Announcement(Stage.REGRESSORS))
    point = FitPoint(resonances=resonances(session.robot, session.fitted_logs))
    columns = build_columns(session, point)
    progress(Announcement(Stage.NOISE))
    steps = coarsest_steps(session.logs)
    simulated = simulated_recordings(session, columns, steps)
    noise, judged_noise = estimate_noise(session, columns)
    sensed = sensed_noise(session, columns, judged_noise)
    noise = at_least_encoder_noise(noise, simulated.residual, columns.usable)
    noise = at_least_sensor_noise(columns, noise, sensed)
    search = _set_up(session, columns, noise, allowed)
    spurious = spurious_gains(search, simulated, noise)
    encoders = noise_floor(session, columns, simulated.residual)
    del simulated
    search = _with_thresholds(search, noise, spurious, progress)
    record = search.record
    last = (
        Explanation(search, frozenset(), noise)
        if allowed is None
        else _explained_by_search(search, noise, sensed, progress)
    )
    found_before: tuple[FoundEffect, ...] = ()
    tried_rivals: set[tuple[str, str | None]] = set()
    for _ in range(0 if allowed is None else _REFINEMENTS):
        noise, ratio = _noise_after(last.search, last.chosen, last.noise, sensed)
        last = replace(last, noise=noise)
        fitted = last.search.held_out_fit(last.chosen)
        found, rivals = found_effects(fitted, last.chosen), runners_up(last.search, last.chosen)
        points = (*found, *rivals)
        same = same_points(found, found_before) and tried_rivals.issuperset(rival.effect_joint for rival in rivals)
        # Stop if the noise is hardly smaller, and no law would be linearised about another point.
        if ratio >= rules.LOWER_NOISE and (same or not needs_refinement(points)):
            break
        found_before = found
        tried_rivals.update(rival.effect_joint for rival in rivals)
        if points:
            problem = last.search.problem
            residual = residual_after(problem, held_out_torque(problem, last.chosen, fitted))
            point = replace(point, found=found, runners_up=rivals, residual=residual)
            # Products take much memory, so these are freed before the next ones are computed.
            del last, fitted, problem, search
            columns = build_columns(session, point, before=columns)
        search = _with_thresholds(_set_up(session, columns, noise, allowed, record), noise, spurious, progress)
        last = _explained_by_search(search, noise, sensed, progress, matching_terms(search, found))
    coarse = coarse_joints(session, columns, steps)
    quiet = smaller_noise_in_band(session, columns, last.noise, judged_noise, encoders)
    chosen = with_leading_rivals(last.search, last.chosen)
    fits = 0 if allowed is None else most_fits(session.robot.nv) - length_hint(allowed)
    last.search.fits.without_limit()
    return replace(last, chosen=chosen, fits=fits, in_band=quiet, coarse=coarse, encoders=encoders)


def _noise_after(search: Search, chosen: frozenset[Term], before: Series, sensed: Series) -> tuple[Series, float]:
    """Noise estimated from the residual of a set of effects.

    A fit with weights from too large a noise has a larger residual than necessary. So the fit is repeated with weights
    from its own residual.

    Args:
        search: The search in which the effects are found.
        chosen: The effects.
        before: Noise by which that search is weighted.
        sensed: Noise of the sensors, of each log; the result is at least as large.

    Returns:
        The noise, and the smallest ratio of new to old noise of all joints.
    """
    noise, ratio = smaller_noise(search, chosen, before)
    if ratio >= rules.LOWER_NOISE:
        return noise, ratio
    columns = search.problem.columns
    few, terms = columns_for(columns, chosen)
    for _ in range(_WEIGHED_AGAIN):
        again = _set_up(search.problem.session, few, noise)
        noise, lower = smaller_noise(again, frozenset(terms.values()), noise)
        if lower >= rules.LOWER_NOISE:
            break
    noise = at_least_sensor_noise(columns, noise, sensed)
    new, old = (sum(np.sum(part**2, axis=0) for part in series) for series in (noise, before))
    return noise, float(np.min(np.sqrt(new / np.maximum(old, 1e-300)), where=old > 0, initial=1.0))


def _set_up(
    session: Session,
    columns: Columns,
    noise: Series,
    allowed: Iterator[int] | None = None,
    record: Record | None = None,
) -> Search:
    """The search over all rivals for a given noise, without thresholds."""
    white, white_noise = whitened(columns, noise)
    weights = weights_of(white, white_noise)
    # The white columns take as much memory as ``columns``, so only their products are kept.
    problem = replace(set_up(session, columns, white, weights), white=replace(white, values=()))
    if columns.displaced:
        read = columns_at_readings(session, columns)
        white, _ = whitened(read, noise)
        read_problem = replace(set_up(session, read, white, weights), white=replace(white, values=()))
        problem = replace(problem, at_readings=read_problem)
    none = np.zeros(len(columns.rows))
    return set_up_search(problem, Threshold(0.0, {}), RowGaps(none, none), {}, record, allowed)


def _with_thresholds(
    search: Search,
    noise: Series,
    spurious: dict[tuple[str, str | None], float],
    progress: Progress,
) -> Search:
    """The search with thresholds from chance, encoder noise and the accuracy of the method."""
    progress(Announcement(Stage.CHANCE))
    problem = search.problem
    filters = whitening_of(problem.columns, noise)
    threshold = null_threshold(search, filters, filters.series(noise), above_chance.LEAST_GAIN)
    rows = row_gaps(problem, search.held_out_fit(frozenset()))
    return set_up_search(problem, threshold, rows, spurious, search.record, search.fits.allowed)


def _explained_by_search(
    search: Search,
    noise: Series,
    sensed: Series,
    progress: Progress,
    start: frozenset[Term] = frozenset(),
) -> Explanation:
    """The explanation by one search, in which effects below the threshold of chance are tested, too.

    The flexible fits that estimate the noise cannot imitate every effect. The torque of an effect that they do not
    imitate counts as noise, which raises the threshold of chance and lowers the weight of slow signals. So
    `_with_less_noise` subtracts the best rival below the threshold from the noise, and everything is set up again for
    the smaller noise. If the rival does not exist, the noise hardly becomes smaller.

    Args:
        search: The search, with thresholds.
        noise: Noise from which the weights of its fits are computed.
        sensed: Noise of the sensors.
        progress: Receives the stages of the diagnosis.
        start: Effects with which the search begins.
    """
    chosen = stepwise_search(search, progress, start)
    for _ in range(_PROBATIONS):
        tried = best_below_threshold(search, chosen)
        if tried is None:
            break
        quieter = _with_less_noise(search, chosen, tried, noise, sensed, progress)
        if quieter is None:
            break
        search, noise = quieter
        chosen = stepwise_search(search, progress, tried)
    return Explanation(search, chosen, noise)


def _with_less_noise(
    search: Search,
    chosen: frozenset[Term],
    tried: frozenset[Term],
    noise: Series,
    sensed: Series,
    progress: Progress,
) -> tuple[Search, Series] | None:
    """A search weighted by less noise, in which effects pass the gates, and that noise; None if there is none.

    The first noise that is tried is the residual after the effects: in short recordings, flexible fits predict less
    than the effects do. The second one is the given noise without the trace of the effects.

    Args:
        search: The search in which the effects fail.
        chosen: The set without them.
        tried: The set with them.
        noise: Noise by which that search is weighted.
        sensed: Noise of the sensors.
        progress: Receives the stages of the diagnosis.
    """
    session, columns = search.problem.session, search.problem.columns

    def less_noise() -> Iterator[Series]:
        residual, ratio = _noise_after(search, tried, noise, sensed)
        if ratio < rules.LOWER_NOISE:
            yield residual
        untraced, gain = noise_without_remainder(search, tried, chosen, noise)
        if gain >= rules.LEAST_TRACE:
            yield untraced

    for quiet in less_noise():
        quieter = _set_up(session, columns, quiet, search.fits.allowed, search.record)
        quieter = _with_thresholds(quieter, quiet, search.spurious, progress)
        if passes_gates(quieter, tried, chosen):
            quieter.record.add_passed(tried - chosen, *gate_results(quieter, tried, chosen))
            return quieter, quiet
    return None
