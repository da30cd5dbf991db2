"""The judged band: least squares fits of the chosen effects there, and which of them are visible above its noise."""

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
    """Problem and noise floor of the band in which gaps are measured.

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
        """What a sound model leaves on each joint: noise and discrepancy, ``(nv,)``."""
        return self.floor if self.discrepancy is None else np.hypot(self.floor, self.discrepancy)

    def narrow(self, series: Series) -> Series:
        """Series of each log in the judged band."""
        return self.problem.session.in_judged_band(series)


def narrow_search(search: Search, noise: Series) -> Search:
    """The search with fits by plain least squares in the judged band.

    Whitened fits separate effects best. Once the effects are chosen, the plain fit closes most of the gap, and its
    parameters are less biased where a real effect differs from its law. Where friction holds a joint, its residual says
    little of the model: these samples weigh as little as in the figures of the gap.
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
        edges: Frequencies [Hz].
    """
    session = search.problem.session

    def each(series: Series) -> Series:
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
            residual=each(columns.residual),
            model_torque=each(columns.model_torque),
        )

    narrow, own = below(columns), each(noise)
    trust = weights_without_filter(narrow, own)
    certain = tuple(part * one for part, one in zip(own, trust, strict=True))
    weights = replace(weights_of(narrow, certain), trust=trust)
    plain = set_up(session, columns, narrow, weights)
    if columns.displaced:
        read = columns_at_readings(session, columns)
        plain = replace(plain, at_readings=set_up(session, read, below(read), weights))
    return set_up_search(plain, search.threshold, search.rows, search.spurious, search.record)
