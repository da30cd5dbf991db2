"""Noise floor and plain least-squares fits in the judged band, the frequency band in which gaps are measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.column_variants import columns_at_readings, with_wider_band
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.problem import Problem, set_up
from identification.diagnosis.noise.noise_floor import weights_of
from identification.diagnosis.noise.whitening import weights_without_filter
from identification.diagnosis.search.search import Search, set_up_search
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class JudgedBand:
    """Problem and noise floor of the judged band.

    Attributes:
        problem: Recordings, columns and blocks.
        floor: Noise floor of each joint in the judged band, root mean square, ``(nv,)``.
        highest: Upper end of the interval of the noise floor, ``(nv,)``.
        discrepancy: Error of a sound model on each joint, root mean square, ``(nv,)``; None counts as zero.
    """

    problem: Problem
    floor: Float[Array, " nv"]
    highest: Float[Array, " nv"]
    discrepancy: Float[Array, " nv"] | None = None

    @property
    def sound_residual(self) -> Float[Array, " nv"]:
        """Root mean square residual of each joint with a sound model: noise and discrepancy, ``(nv,)``."""
        return self.floor if self.discrepancy is None else np.hypot(self.floor, self.discrepancy)


def plain_search(search: Search, noise: Series) -> Search:
    """The search with plain least-squares fits in the judged band in place of fits to whitened residuals.

    Whitened fits separate effects best. Once the effects are chosen, plain fits close more of the gap, and their
    parameters are less biased if a real effect differs from its law. Samples at which friction may hold a joint say
    little about the model. They have the same small weights as in the figures of the gap.

    Args:
        search: Rivals, with whitened fits.
        noise: Noise of each log's torque.
    """
    session = search.problem.session
    columns = with_wider_band(session, search.problem.columns)
    return search_below(search, columns, noise, np.full(len(columns.rows), session.cutoff_hz))


def search_below(search: Search, columns: Columns, noise: Series, edges: Float[Array, " nv"]) -> Search:
    """The search with plain least-squares fits to frequencies below a limit for each joint.

    Args:
        search: Rivals.
        columns: Columns of the search, or only those of the rivals that are needed, which saves memory.
        noise: Noise of each log's torque.
        edges: Limit of each joint [Hz], ``(nv,)``.
    """
    session = search.problem.session

    def log_below(values: Float[Array, "n nv"], k: int) -> Float[Array, "n nv"]:
        if (edges >= 0.99 * session.logs[k].band.cutoff_hz).all():
            # The log has been filtered to this band already.
            return values
        return np.column_stack([session.log_below(x, k, edges[j]) for j, x in enumerate(values.T)])

    def series_below(series: Series) -> Series:
        return tuple(log_below(values, k) for k, values in enumerate(series))

    def columns_below(columns: Columns) -> Columns:
        return replace(
            columns,
            values=tuple(
                tuple(session.log_below(x, k, edges[j]) for j, x in enumerate(rows))
                for k, rows in enumerate(columns.values)
            ),
            residual=series_below(columns.residual),
            model_torque=series_below(columns.model_torque),
        )

    narrow, noise_below = columns_below(columns), series_below(noise)
    trust = weights_without_filter(narrow, noise_below)
    weighted_noise = tuple(part * weight for part, weight in zip(noise_below, trust, strict=True))
    weights = replace(weights_of(narrow, weighted_noise), trust=trust)
    plain = set_up(session, columns, narrow, weights)
    if columns.displaced:
        read = columns_at_readings(session, columns)
        plain = replace(plain, at_readings=set_up(session, read, columns_below(read), weights))
    return set_up_search(plain, search.threshold, search.gaps, search.spurious, search.record)
