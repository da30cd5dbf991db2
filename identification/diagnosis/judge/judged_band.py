"""The judged band, in which gaps are measured: its noise floor, and fits by plain least squares in it."""

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
class Judge:
    """Problem and noise floor of the judged band.

    Attributes:
        problem: Columns and fits.
        floor: Noise floor of each joint in that band, ``(nv,)``.
        highest: Upper end of its interval, ``(nv,)``.
        discrepancy: Error of a sound model on each joint, ``(nv,)``; None for none.
    """

    problem: Problem
    floor: Float[Array, " nv"]
    highest: Float[Array, " nv"]
    discrepancy: Float[Array, " nv"] | None = None

    @property
    def sound(self) -> Float[Array, " nv"]:
        """Residual of each joint with a sound model, noise and discrepancy, ``(nv,)``."""
        return self.floor if self.discrepancy is None else np.hypot(self.floor, self.discrepancy)


def plain_search(search: Search, noise: Series) -> Search:
    """The search with fits by plain least squares in the judged band.

    Whitened fits separate effects best. Once the effects are chosen, the plain fit closes most of the gap, and its
    parameters are less biased if a real effect differs from its law. While friction holds a joint, its residual says
    little about the model, so that these samples have the same small weights as in the figures of the gap.

    Args:
        search: Rivals, with whitened fits.
        noise: Noise of each log's torque.
    """
    session = search.problem.session
    columns = with_wider_band(session, search.problem.columns)
    return search_below(search, columns, noise, np.full(len(columns.rows), session.cutoff_hz))


def search_below(search: Search, columns: Columns, noise: Series, edges: Float[Array, " nv"]) -> Search:
    """The search with plain fits to the frequencies below a limit on each joint.

    Args:
        search: Rivals.
        columns: Its columns, or only those of the rivals that are needed: their products take most memory.
        noise: Noise of each log's torque.
        edges: Limit of each joint [Hz], ``(nv,)``.
    """
    session = search.problem.session

    def series_below(series: Series) -> Series:
        return tuple(
            part
            if (edges >= 0.99 * session.logs[k].band.cutoff_hz).all()
            else np.column_stack([session.log_below(x, k, edges[j]) for j, x in enumerate(part.T)])
            for k, part in enumerate(series)
        )

    def below(columns: Columns) -> Columns:
        return replace(
            columns,
            values=tuple(
                tuple(session.log_below(x, k, edges[j]) for j, x in enumerate(rows))
                for k, rows in enumerate(columns.values)
            ),
            residual=series_below(columns.residual),
            model_torque=series_below(columns.model_torque),
        )

    narrow, own_noise = below(columns), series_below(noise)
    trust = weights_without_filter(narrow, own_noise)
    certain = tuple(part * weight for part, weight in zip(own_noise, trust, strict=True))
    weights = replace(weights_of(narrow, certain), trust=trust)
    plain = set_up(session, columns, narrow, weights)
    if columns.displaced:
        read = columns_at_readings(session, columns)
        plain = replace(plain, at_readings=set_up(session, read, below(read), weights))
    return set_up_search(plain, search.threshold, search.rows, search.spurious, search.record)
