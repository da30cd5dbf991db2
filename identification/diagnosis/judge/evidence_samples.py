"""Samples of torque and motion that show the findings of a diagnosis: what figures and laws of the rest are made of."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.regimes import regime_split
from phantom_dyn.array_types import Array, Float


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
        log.band(operation.transmitted) for log, operation in zip(logs, columns.operations, strict=True)
    )
    splits = [regime_split(problem, given, row) for row in range(len(columns.rows))]
    touched = [~log.untouched_in_band for log in logs if log.touched is not None]
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
        valid=np.concatenate([log.valid_in_band for log in logs]),
        touched=np.concatenate(touched) if len(touched) == len(logs) else None,
    )
