"""From the effects that were chosen to everything that a diagnosis says, in the judged band."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from identification.diagnosis.bounds import smallest_seen
from identification.diagnosis.columns import Columns
from identification.diagnosis.encoder_noise import Coarse
from identification.diagnosis.fitting import Fitted
from identification.diagnosis.flexible import held_out_ridge, state_features
from identification.diagnosis.gap import (
    Sums,
    held_out_torque,
    in_judged_band,
    residual_after,
    sums,
)
from identification.diagnosis.judge import Judge, gap_is_there, narrow_search, noise_floor, visible
from identification.diagnosis.locate import regime_shares
from identification.diagnosis.noise import rms
from identification.diagnosis.parameters import Neighbour, finding_parameters
from identification.diagnosis.problem import Problem
from identification.diagnosis.quantized import findings_of, floor_without, rounded
from identification.diagnosis.result import (
    Adjusted,
    Diagnosis,
    Evidence,
    Finding,
    JointGap,
    Unexplained,
)
from identification.diagnosis.rivals import block_counts, stand
from identification.diagnosis.search import Search, ordered
from identification.diagnosis.terms import Term, merged
from identification.log import Log
from identification.recordings import Recording
from phantom_dyn import __version__
from phantom_dyn.robot import Robot

Array = np.ndarray

# A rest is structured if a flexible model takes at least this share off its loss, three standard errors over blocks.
_STRUCTURE = 0.08
_STRUCTURE_ERRORS = 3.0


def assemble(
    robot: Robot,
    recordings: tuple[Recording, ...],
    logs: tuple[Log, ...],
    cutoff_hz: float,
    search: Search,
    chosen: frozenset[Term],
    noise: tuple[Float[Array, "n nv"], ...],
    coarse: tuple[Coarse, ...],
    progress: Callable[[str], None],
    started: float,
) -> Diagnosis:
    """Put everything that the search has found into the shape of the contract."""
    plain = narrow_search(search, logs, cutoff_hz, noise)
    chosen = visible(plain, chosen, logs, cutoff_hz)
    if not gap_is_there(plain.problem, logs, cutoff_hz, noise):
        chosen = frozenset()
    problem = plain.problem
    columns = problem.columns
    named = frozenset(term for term in chosen if term.named)
    found = plain.evaluate(named)
    torque = held_out_torque(problem, named, found)
    rest = in_judged_band(residual_after(problem, torque), logs, cutoff_hz)
    given = in_judged_band(columns.residual, logs, cutoff_hz)
    before, after = sums(problem, given), sums(problem, rest)
    whole = rest
    if named != chosen:
        whole = in_judged_band(
            residual_after(problem, held_out_torque(problem, chosen, plain.evaluate(chosen))), logs, cutoff_hz
        )
    # What is left is at least noise, so noise is at most what is left.
    left = sums(problem, whole).rms()
    floor = np.minimum(noise_floor(columns, logs, cutoff_hz, noise), np.where(left > 0, left, np.inf))
    moved = held_out_torque(problem, frozenset(), plain.evaluate(frozenset()))
    within = sums(problem, in_judged_band(residual_after(problem, moved), logs, cutoff_hz))
    rounding = rounded(problem, logs, cutoff_hz, coarse, floor, noise)
    floor = floor_without(rounding, floor)
    judge = Judge(problem, logs, cutoff_hz, floor)
    smooth = tuple(w - p for w, p in zip(whole, _flexible_rest(problem, logs, whole), strict=True))
    predicted = tuple(r - s for r, s in zip(rest, smooth, strict=True))
    findings = (
        *_findings(robot, search, plain, chosen, judge, before),
        *findings_of(robot, rounding, before, floor),
    )
    findings = tuple(sorted(findings, key=lambda finding: -finding.gap_closed))
    shares = [regime_shares(columns, logs, given, j) for j in range(robot.nv)]
    unexplained = _unexplained(robot, judge, predicted, before, within, after, sums(problem, smooth), chosen - named)
    progress("stating what would have been seen")
    bounds, untested = smallest_seen(robot, merged(columns.operations), search, chosen)
    gaps = tuple(
        JointGap(
            joint,
            robot.torque_units[j],
            float(before.rms()[j]),
            float(np.sqrt(max(after.rms()[j] ** 2 - rounding.total[j], 0.0))),
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
        not_testable=untested,
        data_warnings=(*robot.warnings, *(w for recording in recordings for w in recording.warnings)),
        next_experiment=None,
        rollout=None,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=_evidence(judge, torque, tuple(s for s, _ in shares)),
    )


def _findings(
    robot: Robot,
    search: Search,
    plain: Search,
    chosen: frozenset[Term],
    judge: Judge,
    before: Sums,
) -> tuple[Finding, ...]:
    """Findings with their gap closed and rivals, the largest first."""
    problem, floor, found = plain.problem, judge.floor, plain.evaluate(chosen)
    after = sums(problem, judge.narrow(residual_after(problem, held_out_torque(problem, chosen, found))))
    counts = block_counts(len(before.counts), np.random.default_rng(20260105))
    once = np.ones((1, len(before.counts)))
    out = []
    for term in ordered(chosen):
        if not term.named:
            continue
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
                parameters=finding_parameters(robot, term, found, neighbours_of(plain, chosen, term)),
                gap_closed=float(closed(once)[0]),
                gap_closed_interval=(float(low), float(high)),
                probability=standing.probability,
                rivals=standing.rivals,
                verdict="one_of" if standing.rivals else "supported",
            )
        )
    return tuple(out)


def neighbours_of(search: Search, chosen: frozenset[Term], term: Term) -> tuple[Neighbour, ...]:
    """Fits with the other shapes of one finding."""
    out = []
    for other in search.terms:
        if other.place == term.place and other is not term and len(other.shape) == len(term.shape) == 1:
            found = search.evaluate(chosen - {term} | {other})
            out.append(Neighbour(other.shape[0], found.objective, found.theta[list(other.columns)]))
    return tuple(out)


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
    within: Sums,
    after: Sums,
    smooth: Sums,
    nameless: frozenset[Term],
) -> Unexplained:
    """How much of the explainable gap is left, and where it sits if it has structure."""
    floor = judge.floor
    once = np.ones((1, len(before.counts)))
    allowed, left, best = (float(s.loss(floor, once)[0]) for s in (within, after, smooth))
    gains = (after.squares - smooth.squares) / floor**2
    total = gains.sum(axis=1)
    error = float(np.sqrt(len(total)) * total.std()) + 1e-12
    structured = bool(nameless) or bool(left - best > _STRUCTURE * left and total.sum() > _STRUCTURE_ERRORS * error)
    # What moves within the tolerances explain is no gap.
    explainable = allowed - min(best, left)
    fraction = float(np.clip((left - best) / explainable, 0.0, 1.0)) if explainable > 0 else 0.0
    joint, regime = None, None
    if structured:
        row = int(np.argmax(gains.sum(axis=0)))
        joint = robot.joint_names[row]
        _, regime = regime_shares(judge.problem.columns, judge.logs, predicted, row)
        here = [term.effect.regime for term in ordered(nameless) if term.joint == joint]
        regime = here[0] if here else regime
    return Unexplained(fraction, structured, joint, regime)


def _verdict(findings: tuple[Finding, ...], unexplained: Unexplained, columns: Columns) -> str:
    """The contract's verdict."""
    if not any(use.any() for use in columns.usable):
        return "not_testable"
    little = not unexplained.structured or unexplained.fraction_of_explainable < 0.1
    if not findings:
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
