"""Gap, findings, detection limits and verdict of an explanation, all measured in the judged band."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from identification.diagnosis.explanation import Explanation
from identification.diagnosis.fit.gap import Sums, held_out_torque, residual_after, sums
from identification.diagnosis.judge.bounds import smallest_seen
from identification.diagnosis.judge.bursts import bursts_of
from identification.diagnosis.judge.coarse_encoders import Rounded, findings_of, floor_without, rounded
from identification.diagnosis.judge.findings import Shown, findings_without, shown_effects, size_doubts
from identification.diagnosis.judge.judged_band import Judge, narrow_search, noise_floor
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.judge.verdict import adjusted, unexplained, verdict
from identification.diagnosis.model.operations import friction_with
from identification.diagnosis.model.terms import merged
from identification.diagnosis.result import Evidence, JointGap, Judgement
from identification.diagnosis.search.refinement import found_effects

Array = np.ndarray


def judged(explanation: Explanation, progress: Callable[[str], None]) -> tuple[Judgement, Shown]:
    """Gap, findings, bounds and verdict of an explanation, and the effects that are shown with their fits."""
    search, noise = explanation.search, explanation.noise
    session = search.problem.session
    shown = shown_effects(search, narrow_search(search, noise), explanation.chosen, noise)
    problem = shown.problem
    given = session.in_judged_band(problem.columns.residual)
    torque = held_out_torque(problem, shown.named, shown.found)
    residual = session.in_judged_band(residual_after(problem, torque))
    whole = residual
    if shown.named != shown.chosen:
        predicted = held_out_torque(problem, shown.chosen, shown.plain.evaluate(shown.chosen))
        whole = session.in_judged_band(residual_after(problem, predicted))
    # What is left is at least noise, so noise is at most what is left.
    left = sums(problem, whole).rms()
    floor = np.minimum(noise_floor(session, problem.columns, noise), np.where(left > 0, left, np.inf))
    rounding = rounded(problem, explanation.coarse, floor, noise)
    floor = floor_without(rounding, floor)
    judge = Judge(problem, floor)
    before = sums(problem, given)
    # Without a coarse reading the model is the same: what it feigns is no torque.
    pairs = [
        *findings_without(shown, judge, before),
        *((finding, torque) for finding in findings_of(session.robot, rounding, before, floor)),
    ]
    pairs.sort(key=lambda pair: -pair[0].gap_closed)
    findings = tuple(finding for finding, _ in pairs)
    left_over = unexplained(shown, judge, residual, whole)
    progress("stating what would have been seen")
    bounds, untested = smallest_seen(merged(problem.columns.operations), search, shown.plain, shown.chosen)
    judgement = Judgement(
        verdict=verdict(findings, left_over, problem.columns),
        joints=_joint_gaps(judge, before, sums(problem, residual), rounding),
        findings=findings,
        adjusted=adjusted(problem, shown.found),
        unexplained=left_over,
        bounds=bounds,
        not_testable=untested,
        notes=size_doubts(shown),
        evidence=evidence_of(judge, given, torque, tuple(without for _, without in pairs)),
        bursts=bursts_of(problem, whole, _friction(shown)),
    )
    return judgement, shown


def _friction(shown: Shown) -> tuple[Float[Array, "N nv"], ...]:
    """Friction torque of each log, of the model and of what was found."""
    found = found_effects(shown.plain.evaluate(shown.chosen), shown.chosen)
    return tuple(friction_with(operation, found) for operation in shown.problem.columns.operations)


def _joint_gaps(judge: Judge, before: Sums, after: Sums, rounding: Rounded) -> tuple[JointGap, ...]:
    """Gap of each joint before and after, without what coarse readings feign after it."""
    robot = judge.problem.session.robot
    return tuple(
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
    problem = judge.problem
    columns, logs = problem.columns, problem.session.logs
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
    splits = [regime_split(problem, given, row) for row in range(len(columns.rows))]
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
