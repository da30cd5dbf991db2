"""From a robot and its recordings to a diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.blocks import Block, assign_folds, build_grams, split_blocks
from identification.diagnosis.bounds import sensor_blind, smallest_seen
from identification.diagnosis.columns import Columns, KnownEffect, Term, build_columns, merged_motion
from identification.diagnosis.fitting import Fitted, Problem, set_up
from identification.diagnosis.flexible import held_out_ridge, state_features
from identification.diagnosis.gap import (
    Sums,
    held_out_torque,
    in_judged_band,
    residual_after,
    row_counts,
    row_losses,
    sums,
)
from identification.diagnosis.locate import regime_shares
from identification.diagnosis.noise import estimate_noise, rms, smaller_noise, weights_of
from identification.diagnosis.null import null_threshold
from identification.diagnosis.parameters import finding_parameters
from identification.diagnosis.result import (
    Adjusted,
    Diagnosis,
    Evidence,
    Finding,
    JointGap,
    Unexplained,
)
from identification.diagnosis.rivals import block_counts, stand
from identification.diagnosis.search import Search, explain, ordered, set_up_search
from identification.diagnosis.whitening import whitened
from identification.log import Log
from identification.recordings import Recording
from identification.signals import process_all, smoothed
from phantom_dyn import __version__
from phantom_dyn.errors import LogError
from phantom_dyn.robot import Robot

Array = np.ndarray

# Noise floors are refined if the explanation leaves less than this share of one.
_LOWER = 0.9
# A claim closes at least this share of the gap: less is what a law of the right kind leaves that is off by 5 %.
_LEAST_SHARE = 0.004
# Fewer blocks of at least a second cannot be held out in turn.
_LEAST_BLOCKS = 4
# Alignment, derivatives and the tolerance taken as linear are right to about one per cent of the torque they explain.
_ACCURACY = 0.0002
# Without a finding, the squared residual of a joint in the judged band grows by at least this share.
_VISIBLE = 0.03
# A claim gains at least this on held-out data, whatever chance gives.
_LEAST_GAIN = 10.0
# A rest is structured if a flexible model takes at least this share off its loss, three standard errors over blocks.
_STRUCTURE = 0.08
_STRUCTURE_ERRORS = 3.0


@dataclass(frozen=True)
class Judge:
    """In which band, and against which noise, gaps are measured.

    Attributes:
        problem: Columns and fits.
        logs: Recordings, ready for fitting.
        cutoff_hz: Edge of the judged band.
        floor: Noise floor of each joint in that band, ``(nv,)``.
    """

    problem: Problem
    logs: tuple[Log, ...]
    cutoff_hz: float
    floor: Float[Array, " nv"]

    def narrow(self, series: tuple[Float[Array, "n nv"], ...]) -> tuple[Float[Array, "n nv"], ...]:
        """Series of each log in the judged band."""
        return in_judged_band(series, self.logs, self.cutoff_hz)


def diagnose(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    hold_out: tuple[Recording, ...] = (),
    known: tuple[KnownEffect, ...] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say where the gap between robot and recordings lies, what causes it, and how far it shrinks.

    Args:
        robot: The model that is judged.
        recordings: What fits may see; they are judged on blocks that they have not seen.
        hold_out: Recordings that no fit sees; if there are any, all figures are those on them.
        known: Effects that belong to the given model already.
        progress: Told in words what is being done.

    Raises:
        LogError: If a recording cannot be used.
    """
    started = time.perf_counter()
    progress("filtering")
    every = (*recordings, *hold_out)
    logs, cutoff_hz = process_all(every, robot)
    progress("computing regressors")
    columns = build_columns(robot, logs, cutoff_hz, known)
    blocks = split_blocks(logs, cutoff_hz)
    folds = assign_folds(blocks, np.array([k >= len(recordings) for k in range(len(every))]))
    if np.sum(folds >= 0) < _LEAST_BLOCKS:
        seconds = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
        raise LogError(
            f"{recordings[0].file}: {seconds:.1f} s are too short to hold data back and judge on them: "
            "record at least ten seconds of motion."
        )
    progress("estimating the noise")
    noise = estimate_noise(columns, logs, blocks, folds)
    search, chosen = _search(columns, blocks, folds, noise, progress)
    noise, ratio = smaller_noise(search, chosen, noise)
    if ratio < _LOWER:
        search, chosen = _search(columns, blocks, folds, noise, progress)
    progress("comparing rivals")
    return _assemble(robot, every, logs, cutoff_hz, search, chosen, noise, progress, started)


def _visible(search: Search, chosen: frozenset[Term], logs: tuple[Log, ...], cutoff_hz: float) -> frozenset[Term]:
    """Findings without those whose loss nobody would see in the judged band.

    Without a finding the squared residual of some joint has to grow by a share of what is left: an effect can be
    significant only above the judged band, where it is of no use and the model of the noise is least known.
    """
    problem = search.problem

    def squares(kept: frozenset[Term]) -> Float[Array, " nv"]:
        torque = held_out_torque(problem, kept, search.evaluate(kept))
        return sums(problem, in_judged_band(residual_after(problem, torque), logs, cutoff_hz)).rms() ** 2

    while chosen:
        base = np.maximum(squares(chosen), 1e-300)
        growth = {}
        for term in ordered(chosen):
            ratio = squares(chosen - {term}) / base
            # It has to help the worst joint, and not cost the others more than it helps.
            growth[term] = float(np.max(ratio)) - 1.0 if np.mean(ratio) > 1.0 else -1.0
        least = min(growth, key=lambda term: growth[term])
        if growth[least] >= _VISIBLE:
            return chosen
        chosen = chosen - {least}
    return chosen


def _gap_is_there(
    problem: Problem, logs: tuple[Log, ...], cutoff_hz: float, noise: tuple[Float[Array, "n nv"], ...]
) -> bool:
    """False if the given model's residual is noise on every joint: then there is nothing to find a cause for."""
    floor = _floor(problem.columns, logs, cutoff_hz, noise)
    given = sums(problem, in_judged_band(problem.columns.residual, logs, cutoff_hz)).rms()
    return bool(np.any(given**2 > (1.0 + _VISIBLE) * floor**2))


def _narrow_search(
    search: Search, logs: tuple[Log, ...], cutoff_hz: float, noise: tuple[Float[Array, "n nv"], ...]
) -> Search:
    """The same search with fits by plain least squares in the judged band.

    Whitened fits tell effects apart best. Once the effects are chosen, the plain fit is the one that closes the gap,
    and its parameters suffer less where a real effect is not quite its law.
    """
    problem = search.problem
    columns = problem.columns
    steps = [log.band.rate_hz / log.band.step for log in logs]
    wide = cutoff_hz < 0.99 * min(log.band.cutoff_hz for log in logs)
    narrow = columns
    if wide:
        values = tuple(
            tuple(smoothed(row, rate, cutoff_hz) for row in rows)
            for rows, rate in zip(columns.values, steps, strict=True)
        )
        narrow = replace(
            columns,
            values=values,
            residual=in_judged_band(columns.residual, logs, cutoff_hz),
            model_torque=in_judged_band(columns.model_torque, logs, cutoff_hz),
        )
    weights = weights_of(narrow, in_judged_band(noise, logs, cutoff_hz))
    grams = build_grams(narrow, problem.blocks, problem.grams.fold, weights)
    plain = set_up(columns, narrow, problem.blocks, weights, grams)
    return set_up_search(plain, search.threshold, search.row_thresholds)


def _search(
    columns: Columns,
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
    noise: tuple[Float[Array, "n nv"], ...],
    progress: Callable[[str], None],
) -> tuple[Search, frozenset[Term]]:
    """The best set of effects for given noise."""
    white, white_noise = whitened(columns, noise)
    weights = weights_of(white, white_noise)
    problem = set_up(columns, white, blocks, weights, build_grams(white, blocks, folds, weights))
    search = set_up_search(problem, 0.0, np.zeros(len(columns.rows)))
    progress("measuring what chance gives")
    threshold = max(_LEAST_GAIN, null_threshold(search, white_noise))
    given, gap = (
        np.maximum(loss - row_counts(problem), 0.0) for loss in row_losses(problem, search.evaluate(frozenset()))
    )
    search = set_up_search(problem, threshold, _LEAST_SHARE * gap + _ACCURACY * given)
    return search, explain(search, progress)


def _assemble(
    robot: Robot,
    recordings: tuple[Recording, ...],
    logs: tuple[Log, ...],
    cutoff_hz: float,
    search: Search,
    chosen: frozenset[Term],
    noise: tuple[Float[Array, "n nv"], ...],
    progress: Callable[[str], None],
    started: float,
) -> Diagnosis:
    """Put everything that the search has found into the shape of the contract."""
    plain = _narrow_search(search, logs, cutoff_hz, noise)
    chosen = _visible(plain, chosen, logs, cutoff_hz)
    if not _gap_is_there(plain.problem, logs, cutoff_hz, noise):
        chosen = frozenset()
    problem = plain.problem
    columns = problem.columns
    found = plain.evaluate(chosen)
    torque = held_out_torque(problem, chosen, found)
    rest = in_judged_band(residual_after(problem, torque), logs, cutoff_hz)
    given = in_judged_band(columns.residual, logs, cutoff_hz)
    before, after = sums(problem, given), sums(problem, rest)
    # What is left is at least noise, so noise is at most what is left.
    floor = np.minimum(_floor(columns, logs, cutoff_hz, noise), np.where(after.rms() > 0, after.rms(), np.inf))
    judge = Judge(problem, logs, cutoff_hz, floor)
    predicted = _flexible_rest(problem, logs, rest)
    smooth = sums(problem, tuple(r - p for r, p in zip(rest, predicted, strict=True)))
    findings = _findings(robot, search, plain, chosen, judge, before, after)
    shares = [regime_shares(columns, logs, given, j) for j in range(robot.nv)]
    unexplained = _unexplained(robot, judge, predicted, before, after, smooth)
    progress("stating what would have been seen")
    bounds, untested = smallest_seen(robot, merged_motion(logs), search, chosen)
    gaps = tuple(
        JointGap(
            joint,
            robot.torque_units[j],
            float(before.rms()[j]),
            float(after.rms()[j]),
            float(judge.floor[j]),
            int(after.counts[:, j].sum()),
        )
        for j, joint in enumerate(robot.joint_names)
    )
    return Diagnosis(
        verdict=_verdict(findings, unexplained, columns),
        robot=robot.name,
        recordings=tuple(recording.file for recording in recordings),
        joints=gaps,
        band_hz=(0.0, float(cutoff_hz)),
        findings=findings,
        adjusted=_adjusted(problem, found),
        unexplained=unexplained,
        bounds=bounds,
        not_testable=(*untested, *sensor_blind(robot)),
        data_warnings=(*robot.warnings, *(w for recording in recordings for w in recording.warnings)),
        next_experiment=None,
        rollout=None,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=_evidence(judge, torque, tuple(s for s, _ in shares)),
    )


def _floor(
    columns: Columns, logs: tuple[Log, ...], cutoff_hz: float, noise: tuple[Float[Array, "n nv"], ...]
) -> Float[Array, " nv"]:
    """Noise floor of each joint in the judged band, above zero even where nothing was measured."""
    narrow = in_judged_band(noise, logs, cutoff_hz)
    torque = np.concatenate(columns.model_torque)
    return np.array(
        [
            max(
                rms([e[:, j][u[:, j]] for e, u in zip(narrow, columns.usable, strict=True)]),
                1e-6 * torque[:, j].std(),
                1e-12,
            )
            for j in range(len(columns.rows))
        ]
    )


def _findings(
    robot: Robot,
    search: Search,
    plain: Search,
    chosen: frozenset[Term],
    judge: Judge,
    before: Sums,
    after: Sums,
) -> tuple[Finding, ...]:
    """Findings with their gap closed and rivals, the largest first."""
    problem, floor, found = plain.problem, judge.floor, plain.evaluate(chosen)
    counts = block_counts(len(before.counts), np.random.default_rng(20260105))
    once = np.ones((1, len(before.counts)))
    out = []
    for term in ordered(chosen):
        without = plain.evaluate(chosen - {term})
        torque = held_out_torque(problem, chosen - {term}, without)
        lost = sums(problem, judge.narrow(residual_after(problem, torque)))

        def closed(weights: Float[Array, "R B"], lost: Sums = lost) -> Float[Array, " R"]:
            gap = np.maximum(before.loss(floor, weights) - 1.0, 1e-9)
            return (lost.loss(floor, weights) - after.loss(floor, weights)) / gap

        standing = stand(search, chosen, term)
        low, high = np.percentile(closed(counts), [2.5, 97.5])
        out.append(
            Finding(
                effect=term.effect.name,
                joint=term.joint,
                regime=term.effect.regime,
                parameters=finding_parameters(robot, term, found),
                gap_closed=float(closed(once)[0]),
                gap_closed_interval=(float(low), float(high)),
                probability=standing.probability,
                rivals=standing.rivals,
                verdict="one_of" if standing.rivals else "supported",
            )
        )
    return tuple(sorted(out, key=lambda finding: -finding.gap_closed))


def _flexible_rest(
    problem: Problem, logs: tuple[Log, ...], rest: tuple[Float[Array, "n nv"], ...]
) -> tuple[Float[Array, "n nv"], ...]:
    """What a flexible model predicts of the rest on blocks that it has not seen; zero where it does not help."""
    columns = problem.columns
    out = [np.zeros_like(r) for r in rest]
    for j in range(len(columns.rows)):
        x = [state_features(columns, log, k, j) for k, log in enumerate(logs)]
        y, use = [r[:, j] for r in rest], [u[:, j] for u in columns.usable]
        predicted, error = held_out_ridge(x, y, use, problem.blocks, problem.grams.fold)
        if error < rms([v[m] for v, m in zip(y, use, strict=True)]) ** 2:
            for k, p in enumerate(predicted):
                out[k][:, j] = p
    return tuple(out)


def _unexplained(
    robot: Robot,
    judge: Judge,
    predicted: tuple[Float[Array, "n nv"], ...],
    before: Sums,
    after: Sums,
    smooth: Sums,
) -> Unexplained:
    """How much of the explainable gap is left, and where it sits if it has structure."""
    floor = judge.floor
    once = np.ones((1, len(before.counts)))
    given, left, best = (float(s.loss(floor, once)[0]) for s in (before, after, smooth))
    gains = (after.squares - smooth.squares) / floor**2
    total = gains.sum(axis=1)
    error = float(np.sqrt(len(total)) * total.std()) + 1e-12
    structured = bool(left - best > _STRUCTURE * left and total.sum() > _STRUCTURE_ERRORS * error)
    explainable = given - min(best, left)
    fraction = float(np.clip((left - best) / explainable, 0.0, 1.0)) if explainable > 0 else 0.0
    joint, regime = None, None
    if structured:
        row = int(np.argmax(gains.sum(axis=0)))
        joint = robot.joint_names[row]
        _, regime = regime_shares(judge.problem.columns, judge.logs, predicted, row)
    return Unexplained(fraction, structured, joint, regime)


def _verdict(findings: tuple[Finding, ...], unexplained: Unexplained, columns: Columns) -> str:
    """The contract's verdict."""
    if not any(use.any() for use in columns.usable):
        return "not_testable"
    little = not unexplained.structured or unexplained.fraction_of_explainable < 0.1
    if not findings:
        # What the tolerance explains nine tenths of is a robot within its tolerance, not a gap of unknown cause.
        return "no_gap" if little else "unknown"
    if little:
        return "explained"
    return "unknown" if unexplained.fraction_of_explainable > 0.5 else "partly_explained"


def _adjusted(problem: Problem, found: Fitted) -> tuple[Adjusted, ...]:
    """Moves of the model inside its tolerance that the data ask for: beyond two of their deviations."""
    std = np.sqrt(np.diag(found.cov))[: problem.nuisances]
    return tuple(
        Adjusted(nuisance.name, float(change), nuisance.sigma)
        for nuisance, change, deviation in zip(
            problem.columns.nuisances, found.theta[: problem.nuisances], std, strict=True
        )
        if nuisance.relative and abs(change) > 2 * deviation
    )


def _evidence(judge: Judge, torque: tuple[Float[Array, "n nv"], ...], shares: tuple[dict[str, float], ...]) -> Evidence:
    """Samples behind the figures, recordings one after the other with a second between them."""
    columns, logs = judge.problem.columns, judge.logs
    start, times = 0.0, []
    for log in logs:
        t = log.motion.t[log.samples]
        times.append(t - t[0] + start)
        start = float(times[-1][-1]) + 1.0
    model = judge.narrow(columns.model_torque)
    return Evidence(
        t=np.concatenate(times),
        q=np.concatenate([log.motion.q[log.samples] for log in logs]),
        v=np.concatenate([log.motion.v[log.samples] for log in logs]),
        a=np.concatenate([log.motion.a[log.samples] for log in logs]),
        tau_measured=np.concatenate(model) + np.concatenate(judge.narrow(columns.residual)),
        tau_before=np.concatenate(model),
        tau_after=np.concatenate(judge.narrow(torque)),
        regime_shares=shares,
    )
