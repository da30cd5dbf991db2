"""Samples of motion and torque of all recordings, for figures of a report and for a formula of the residual."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.session import Series
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.regimes import regime_split
from phantom_dyn.array_types import Array, Float


def evidence_of(
    judged: JudgedBand,
    given: Series,
    after: Series,
    without: tuple[Series, ...],
) -> Evidence:
    """Samples of all recordings in one series, with a second between two recordings.

    Args:
        judged: Recordings and the judged band.
        given: Residual of the given model for each log, in the judged band; it shows in which regimes of motion the gap
            occurs.
        after: Torque of the corrected model for each log.
        without: For each finding, torque for each log of the corrected model without this finding.
    """
    problem, columns, logs = judged.problem, judged.problem.columns, judged.problem.session.logs

    def in_band(series: Series) -> Float[Array, "N nv"]:
        return np.concatenate(problem.session.in_judged_band(series))

    start, times = 0.0, []
    for log in logs:
        t = log.motion.t[log.samples]
        times.append(t - t[0] + start)
        start = float(times[-1][-1]) + 1.0
    model = in_band(columns.model_torque)
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
        tau_measured=model + in_band(columns.residual),
        tau_before=model,
        tau_after=in_band(after),
        regime_shares=tuple(split.shares for split in splits),
        regime_times=tuple(split.times for split in splits),
        tau_transmitted=in_band(transmitted),
        tau_without=tuple(in_band(torque) for torque in without),
        sample_period=1.0 / float(np.median([log.band.rate_hz for log in logs])),
        valid=np.concatenate([log.valid_in_band for log in logs]),
        touched=np.concatenate(touched) if len(touched) == len(logs) else None,
    )
