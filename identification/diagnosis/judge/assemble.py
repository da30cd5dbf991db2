"""From the effects that were chosen to everything that a diagnosis says, in the judged band.

From the effects that were chosen to everything that a diagnosis says, in the judged band.

Samples behind the figures of a report, all in the judged band.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from identification.data.log import Log
from identification.data.recording import Recording
from identification.diagnosis.fit.gap import held_out_torque, in_judged_band, residual_after, sums
from identification.diagnosis.judge.bounds import smallest_seen
from identification.diagnosis.judge.coarse_encoders import findings_of, floor_without, rounded
from identification.diagnosis.judge.findings import distinct, findings_without
from identification.diagnosis.judge.judged_band import Judge, gap_is_there, narrow_search, noise_floor, visible
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.judge.verdict import adjusted, flexible_rest, unexplained, verdict
from identification.diagnosis.model.terms import KnownEffect, Term, merged
from identification.diagnosis.noise.encoder_noise import Coarse
from identification.diagnosis.result import Diagnosis, Evidence, JointGap
from identification.diagnosis.search.search import Search
from identification.rollout.rollout import Explained, rollout_of
from identification.scenarios.motion_limits import told_by_motion
from phantom_dyn import __version__
from phantom_dyn.model.robot import Robot

Array = np.ndarray


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
    known: tuple[KnownEffect, ...] = (),
) -> Diagnosis:
    """Put everything that the search has found into the shape of the contract."""
    plain = narrow_search(search, logs, cutoff_hz, noise)
    settled, chosen = chosen, visible(plain, chosen, logs, cutoff_hz)
    if not gap_is_there(plain.problem, logs, cutoff_hz, noise):
        chosen = frozenset()
    chosen, fitted = distinct(robot, plain, chosen, logs, cutoff_hz)
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
    smooth = tuple(w - p for w, p in zip(whole, flexible_rest(problem, logs, whole), strict=True))
    predicted = tuple(r - s for r, s in zip(rest, smooth, strict=True))
    # Without a coarse reading the model is the same: what it feigns is no torque.
    pairs = [
        *findings_without(robot, search, plain, chosen, fitted, settled, judge, before),
        *((finding, torque) for finding in findings_of(robot, rounding, before, floor)),
    ]
    pairs.sort(key=lambda pair: -pair[0].gap_closed)
    findings = tuple(finding for finding, _ in pairs)
    left_over = unexplained(robot, judge, predicted, before, within, after, sums(problem, smooth), chosen - named)
    progress("stating what would have been seen")
    bounds, untested = smallest_seen(robot, merged(columns.operations), search, plain, chosen)
    progress("simulating")
    rollout = rollout_of(Explained(robot, known, logs, cutoff_hz, problem, named, found, recordings))
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
    out = Diagnosis(
        verdict=verdict(findings, left_over, columns),
        robot=robot.name,
        recordings=tuple(recording.file for recording in recordings),
        joints=gaps,
        band_hz=(0.0, float(cutoff_hz)),
        findings=findings,
        adjusted=adjusted(problem, found),
        unexplained=left_over,
        bounds=bounds,
        not_testable=untested,
        data_warnings=(
            *robot.warnings,
            *(w for recording in recordings for w in recording.warnings),
            *rollout.warnings,
        ),
        next_experiment=None,
        rollout=rollout.json,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=evidence_of(judge, given, torque, tuple(without for _, without in pairs)),
        notes=rollout.notes,
    )
    return told_by_motion(out, recordings)


def evidence_of(
    judge: Judge,
    given: tuple[Float[Array, "n nv"], ...],
    after: tuple[Float[Array, "n nv"], ...],
    without: tuple[tuple[Float[Array, "n nv"], ...], ...],
) -> Evidence:
    """Samples of all recordings, one after the other with a second between them.

    Args:
        judge: Recordings and their band.
        given: Residual of the given model for each log, in the judged band.
        after: Torque of the corrected model for each log.
        without: The same for each finding, of the model that lacks it.
    """
    columns, logs = judge.problem.columns, judge.logs
    start, times = 0.0, []
    for log in logs:
        t = log.motion.t[log.samples]
        times.append(t - t[0] + start)
        start = float(times[-1][-1]) + 1.0
    model = np.concatenate(judge.narrow(columns.model_torque))
    transmitted = tuple(
        log.band(operation.transmitted - operation.own_friction)
        for log, operation in zip(logs, columns.operations, strict=True)
    )
    splits = [regime_split(columns, logs, given, row) for row in range(len(columns.rows))]
    return Evidence(
        t=np.concatenate(times),
        q=np.concatenate([log.motion.q[log.samples] for log in logs]),
        v=np.concatenate([log.motion.v[log.samples] for log in logs]),
        a=np.concatenate([log.motion.a[log.samples] for log in logs]),
        tau_measured=model + np.concatenate(judge.narrow(columns.residual)),
        tau_before=model,
        tau_after=np.concatenate(judge.narrow(after)),
        regime_shares=tuple(split.shares for split in splits),
        regime_times=tuple(split.times for split in splits),
        tau_transmitted=np.concatenate(judge.narrow(transmitted)),
        tau_without=tuple(np.concatenate(judge.narrow(torque)) for torque in without),
        sample_period=1.0 / float(np.median([log.band.rate_hz for log in logs])),
    )
