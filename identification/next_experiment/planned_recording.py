"""Computes products of columns along a planned motion, whitened and weighted like those of the existing recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Band, Log
from identification.data.signals import low_pass
from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.one_recording_effects import Differences
from identification.diagnosis.columns.residual_columns import Columns, columns_like
from identification.diagnosis.columns.session import Series, session_of_logs
from identification.diagnosis.columns.terms import FoundEffect
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.noise.whitening import (
    filtered,
    friction_variance,
    noise_variance,
    row_autocovariance,
    row_filters,
)
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Number of samples of a planned motion per period of the band's edge frequency.
_SAMPLES = 4.0


@dataclass(frozen=True)
class PlannedRecording:
    """Sampling, filters and noise of a planned recording, taken from the existing recordings.

    Attributes:
        problem: Columns and weights of the diagnosis.
        like: Columns of the existing recordings, restricted to those that are needed.
        union: Indices of the columns whose products are computed.
        band: Filter of a planned motion; its output rate is that of the recordings.
        laws: Autocovariance of each row's noise [torque unit^2], from `row_autocovariance`.
        variance: Variance of the whitened noise of each row [torque unit^2], ``(nv,)``.
        trust: Share of noise in the total variance (of noise and friction errors) of each row, averaged over the
            recordings, ``(nv,)``.
        found: Effects that the diagnosis has found.
    """

    problem: Problem
    like: Columns
    union: Int[Array, " u"]
    band: Band
    laws: tuple[Float[Array, "_"], ...]
    variance: Float[Array, " nv"]
    trust: Float[Array, " nv"]
    found: tuple[FoundEffect, ...]

    def products(self, motion: Motion, robot: Robot) -> Float[Array, "u u"]:
        """Weighted products of the columns in ``union`` over a planned motion, ``(u, u)``.

        Samples at which friction is uncertain, such as reversals, have the same low weight as in the diagnosis.

        Args:
            motion: The motion at the band's rate.
            robot: The robot, which may carry a known load.
        """
        tau = inverse_dynamics(robot, motion)
        log = Log("next", robot.joint_names, motion, tau, self.band, np.ones(len(motion.t), dtype=bool))
        given = self.problem.session
        session = session_of_logs(
            given.robot, (log,), given.cutoff_hz, known=given.known, differences=Differences((robot,))
        )
        columns = columns_like(session, self.like, self.found)
        out = np.zeros((len(self.union), len(self.union)))
        for j, row in enumerate(columns.rows):
            # Places, in the union and in this row, of the columns that both have.
            places = {column: k for k, column in enumerate(row)}
            at = [k for k, column in enumerate(self.union.tolist()) if column in places]
            at_row = [places[column] for column in self.union[at].tolist()]
            filters = row_filters(columns, 0, j, self.laws[j])
            share = noise_share(self.variance[j], friction_variance(columns, 0, j, filters))
            values = filtered(filters, columns.values[0][j][:, at_row])
            values *= np.sqrt(share / self.trust[j])[:, None]
            values = values[columns.usable[0][:, j]]
            out[np.ix_(at, at)] += self.problem.weights.per_sample[j] * values.T @ values
        return out


def _noise_of_row(
    columns: Columns, noise: list[Float[Array, " n"]], row: int, law: Float[Array, "_"]
) -> tuple[float, float]:
    """Variance of a row's whitened noise in the recordings, and its mean share in that of noise and friction."""
    usable = [part[:, row] for part in columns.usable]
    filters = [row_filters(columns, log, row, law) for log in range(len(usable))]
    friction = np.concatenate(
        [friction_variance(columns, log, row, filters[log])[samples] for log, samples in enumerate(usable)]
    )
    variance = noise_variance(columns, noise, row, filters)
    share = max(float(np.mean(noise_share(variance, friction))), 1e-300) if len(friction) else 1.0
    return variance, share


def planned_recording(
    problem: Problem, noise: Series, union: Int[Array, " u"], found: tuple[FoundEffect, ...]
) -> PlannedRecording:
    """The planned recording of a diagnosis, with the sampling of the first log."""
    columns = problem.columns
    wanted = set(union.tolist())
    of_wanted_terms = tuple(
        block for block in columns.term_columns if wanted.intersection(range(block.first, block.first + block.count))
    )
    session = problem.session
    by_row = [[part[:, j] for part in noise] for j in range(session.robot.nv)]
    laws = tuple(row_autocovariance(columns, own, j) for j, own in enumerate(by_row))
    noises = [_noise_of_row(columns, own, j, law) for j, (own, law) in enumerate(zip(by_row, laws, strict=True))]
    variance, trust = (np.array(values) for values in zip(*noises, strict=True))
    like, band = replace(columns, term_columns=of_wanted_terms), coarser(session.logs[0].band)
    return PlannedRecording(problem, like, union, band, laws, variance, trust, found)


def coarser(band: Band) -> Band:
    """A filter with the same output rate and fewer input samples, which are enough for motions without noise."""
    rate = band.output_rate_hz
    step = int(np.ceil(_SAMPLES * band.cutoff_hz / rate))
    if step >= band.step or len(band.kernel) == 1:
        return band
    return replace(low_pass(band.cutoff_hz, step * rate), step=step)
