"""A fitting problem: columns, their products, priors and bounds.

A row is one joint's torque. A column is the torque on all rows per unit of one unknown coefficient, at every sample.
The first columns belong to the nuisances: changes of the model's parameters within their tolerances. The others belong
to terms; a term is one effect on one joint. The products of columns (Gram matrices) are weighted sums over samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.possible_bodies import Body, bodies_of_term
from identification.engine.products.blocks import Block
from identification.engine.products.grams import Grams, RowGrams, Weights, all_row_grams, summed
from identification.engine.products.triangles import diagonal
from phantom_dyn.array_types import Array, Float, Int

# Tolerance parameters are left out of all fits if the torque that they add together, each at its bound, has a sum of
# squares of at most this many noise variances of one sample.
_NEGLIGIBLE_SQUARES = 1.0
# A column consists of rounding errors if its size is below this share of that of the largest column of its effect. The
# prior of its coefficient then has a standard deviation of one, whatever the size of the column is.
_ROUNDING_SHARE = 1e-9


@dataclass(frozen=True)
class Problem:
    """Columns, their Gram matrices, and the priors and bounds of all coefficients.

    Attributes:
        session: Robot, logs, band and blocks.
        columns: All columns, as computed.
        white: The columns after filters that make the noise white; the products are computed from these.
        weights: Weight of each sample of ``white``, from the noise of its row.
        grams: Products of the columns.
        precision: Prior precision of each coefficient about zero, ``(K,)``.
        lower, upper: Bounds, ``(K,)``.
        nuisance_count: Number of leading columns, which are those of the tolerance parameters.
        fitted_nuisances: Indices of the nuisances that the fits contain. The others change these recordings too little
            (`observable_nuisances`).
        total_a, total_b: Products of columns with columns and with the residual, summed over the training blocks.
        rows_of_column: For each column, the rows on which it is not zero.
        bodies: For each effect that changes inertial parameters freely, the bodies with these parameters.
        at_readings: The problem for fits without effects that displace the links: its columns of tolerance parameters
            and rigid bodies are computed at the positions that the encoders read. None if those of ``columns`` are,
            too.
    """

    session: Session
    columns: Columns
    white: Columns
    weights: Weights
    grams: Grams
    precision: Float[Array, " K"]
    lower: Float[Array, " K"]
    upper: Float[Array, " K"]
    nuisance_count: int
    fitted_nuisances: Int[Array, " m"]
    total_a: Float[Array, "K K"]
    total_b: Float[Array, " K"]
    rows_of_column: tuple[frozenset[int], ...]
    bodies: Mapping[Term, tuple[Body, ...]]
    at_readings: Problem | None = None

    def of(self, terms: Iterable[Term]) -> Problem:
        """The problem with the columns that a fit of some effects needs.

        If an effect displaces the links or tilts the base, the columns of tolerance parameters and rigid bodies depend
        on that effect. A fit without the effect uses `at_readings`.
        """
        if self.at_readings is None or {term.effect_joint for term in terms}.issuperset(self.columns.displaced):
            return self
        return self.at_readings

    def bodies_of(self, terms: Iterable[Term]) -> tuple[Body, ...]:
        """Bodies whose inertial parameters the effects change freely, each once, in the order of their columns."""
        free = (term for term in terms if term.effect.inertial == "free")
        found = {body.name: body for term in free for body in self.bodies[term]}
        return tuple(sorted(found.values(), key=lambda body: body.columns))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Stretches of samples that are held out together."""
        return self.session.blocks


def set_up(
    session: Session, columns: Columns, white: Columns, weights: Weights, rows: tuple[RowGrams, ...] | None = None
) -> Problem:
    """The problem with its priors: the tolerances for nuisances, and wide priors for all other coefficients.

    A wide prior keeps coefficients finite that the data do not determine. Its standard deviation is thirty times the
    size at which the column alone would explain the whole residual.

    Args:
        session: Robot, logs, band and blocks.
        columns: All columns, as computed.
        white: The columns after filters that make the noise white.
        weights: Weight of each sample of ``white``.
        rows: Weighted products of each row, if they are known.
    """
    rows = all_row_grams(white, session.blocks, session.folds, weights) if rows is None else rows
    fitted_nuisances = observable_nuisances(columns, rows)
    grams = summed(len(columns.names), rows, session.folds, fitted_nuisances)
    count = len(columns.names)
    energy = np.diag(grams.everything)  # weighted sum of squares of each column
    has_wide_prior, lower, upper = energy > 0, np.full(count, -np.inf), np.full(count, np.inf)
    for term in columns.terms:
        own = list(term.columns)
        # If the motion does not excite one coefficient of a law, its column consists of rounding errors, and the wide
        # prior for so small a column would allow any value.
        has_wide_prior[own] &= energy[own] > _ROUNDING_SHARE**2 * energy[own].max()
        lower[own], upper[own] = np.maximum(lower[own], term.lower), np.minimum(upper[own], term.upper)
    precision = np.where(has_wide_prior, energy / (900.0 * max(grams.c.sum(), 1e-30)), 1.0)
    for k, parameter in enumerate(columns.tolerance_parameters):
        precision[k] = 1.0 / parameter.sigma**2
        lower[k], upper[k] = -parameter.bound, parameter.bound
    rows_of_column: list[set[int]] = [set() for _ in range(count)]
    for j, index in enumerate(columns.rows):
        for k in index:
            rows_of_column[k].add(j)
    return Problem(
        session,
        columns,
        white,
        weights,
        grams,
        precision,
        lower,
        upper,
        len(columns.tolerance_parameters),
        fitted_nuisances,
        grams.total_a,
        grams.b[grams.fold >= 0].sum(axis=0),
        tuple(frozenset(rows) for rows in rows_of_column),
        {term: bodies_of_term(session.robot, term) for term in columns.terms if term.effect.inertial == "free"},
    )


def observable_nuisances(columns: Columns, rows: tuple[RowGrams, ...]) -> Int[Array, " m"]:
    """Indices of the tolerance parameters that change the torque of these recordings noticeably, in order.

    Many inertial parameters of a robot change no recorded torque. A fit with all of them takes several times as long
    for the same result. The parameters left out, each at its bound, together change the weighted torque by no more than
    the noise of one sample.

    Args:
        columns: All columns, those of the tolerance parameters first.
        rows: Weighted products of each row.
    """
    count = len(columns.tolerance_parameters)
    energy = np.zeros(count)
    for row in rows:
        own = np.flatnonzero(row.index < count)
        energy[row.index[own]] += diagonal(row.a.sum(axis=0), own)
    energy *= np.array([parameter.bound for parameter in columns.tolerance_parameters]) ** 2
    smallest = np.argsort(energy, kind="stable")
    return np.sort(smallest[np.cumsum(energy[smallest]) > _NEGLIGIBLE_SQUARES])
