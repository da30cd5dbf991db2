"""Noise of each joint's torque residual: the part that no flexible fit predicts on held-out blocks.

A flexible fit is a ridge regression on many columns and on random features of the joint's state. A row is one joint's
torque. Fits use a wide frequency band. The corrected model is judged in its lower part, the judged band. The noise
floor of a joint is the root mean square of its noise in the judged band.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.flexible import ridge_predictions, state_features
from identification.diagnosis.fit.gap import held_out_torque, least_noise, residual_after
from identification.diagnosis.noise.certain_samples import root_weights
from identification.diagnosis.noise.whitening import whitening_of
from identification.diagnosis.search.search import Search
from identification.engine.autocorrelation import autocorrelation_time
from identification.engine.numerics.two_threads import in_two_threads
from identification.engine.products.grams import Weights
from phantom_dyn.array_types import Array, Bool, Float, Int

# Flexible fits are made `_WEIGHTED_ROUNDS` times, each time with weights from the error of the last fits. They are made
# only once if the square roots of all weights are above `_NEARLY_EQUAL`.
_WEIGHTED_ROUNDS, _NEARLY_EQUAL = 2, 0.95


def estimate_noise(session: Session, columns: Columns) -> tuple[Series, Series]:
    """Part of each joint's residual that no model predicts, for each log ``(n, nv)``; zero where not usable.

    Five models predict each joint's residual, each with more features than the last: the given model alone, laws of the
    motion, tolerance parameters and other linear laws, all columns, and all columns with random features. The noise is
    the error of the best model on held-out blocks. A model with few features may be the best: in a short recording,
    hundreds of columns predict worse than twenty. Most noise is above the judged band, and a model that predicts a
    little of it may be bad inside the band. So the best model is chosen separately for both bands.

    Returns:
        Error of the best model in the whole band, and error of the best one in the judged band.
    """

    def unpredicted(j: int) -> tuple[list[Float[Array, " n"]], list[Float[Array, " n"]]]:
        """Error of the best model of one row in the whole band, and error of the best one in the judged band."""
        use = [usable[:, j] for usable in columns.usable]
        y = [np.where(u, residual[:, j], 0.0) for residual, u in zip(columns.residual, use, strict=True)]
        order, counts = _plain_first(columns, j)
        plain = [values[j][:, order] for values in columns.values]
        rich = [
            np.column_stack([x, state_features(columns, log, k, j)])
            for k, (x, log) in enumerate(zip(plain, session.logs, strict=True))
        ]
        # Numbers of leading features in the models between the given model and the one with all features.
        first = (*counts, plain[0].shape[1])
        whole, judged = y, y
        for _ in range(_WEIGHTED_ROUNDS):
            roots = root_weights(columns, whole, j)
            whole, judged = y, y
            smallest, smallest_judged = _weighted_rms(y, use, roots), _rms_in_judged_band(session, y, use, roots)
            weighted_x = [x * root[:, None] for x, root in zip(rich, roots, strict=True)]
            weighted_y = [part * root for part, root in zip(y, roots, strict=True)]
            for predicted, _ in ridge_predictions(weighted_x, weighted_y, use, session.blocks, session.folds, first):
                error = [
                    np.where(u, residual - weighted / root, 0.0)
                    for u, residual, weighted, root in zip(use, y, predicted, roots, strict=True)
                ]
                size, size_judged = _weighted_rms(error, use, roots), _rms_in_judged_band(session, error, use, roots)
                if size < smallest:
                    whole, smallest = error, size
                if size_judged < smallest_judged:
                    judged, smallest_judged = error, size_judged
            if min(float(root.min(initial=1.0)) for root in roots) > _NEARLY_EQUAL:
                break
        return whole, judged

    rows = in_two_threads(unpredicted, range(len(columns.rows)))
    whole = tuple(np.column_stack(parts) for parts in zip(*(row[0] for row in rows), strict=True))
    judged = tuple(np.column_stack(parts) for parts in zip(*(row[1] for row in rows), strict=True))
    return whole, judged


def smaller_noise_in_band(
    session: Session, columns: Columns, noise: Series, in_band: Series, least: Float[Array, " nv"]
) -> Series:
    """Noise of each joint from the one of two estimates that is smaller in the judged band.

    Args:
        session: Recordings and their judged band.
        columns: Columns with the usable samples.
        noise: The first estimate, which is best in the whole band.
        in_band: The second estimate, which is best in the judged band.
        least: Torque from encoder noise in the judged band, rms of each joint [N m or N]. A second estimate below it is
            not used.
    """
    out = [part.copy() for part in noise]
    for j in range(len(columns.rows)):
        use, own = [u[:, j] for u in columns.usable], [part[:, j] for part in noise]
        roots, other = root_weights(columns, own, j), [part[:, j] for part in in_band]
        first, second = (_rms_in_judged_band(session, series, use, roots) for series in (own, other))
        if least[j] <= second < first:
            for part, quiet in zip(out, in_band, strict=True):
                part[:, j] = quiet[:, j]
    return tuple(out)


def _rms_in_judged_band(
    session: Session,
    parts: Sequence[Float[Array, " n"]],
    use: Sequence[Bool[Array, " n"]],
    roots: Sequence[Float[Array, " n"]],
) -> float:
    """Root mean square of a row's usable samples in the judged band, each multiplied by the root of its weight."""
    return _weighted_rms([session.log_in_judged_band(part, k) for k, part in enumerate(parts)], use, roots)


def _plain_first(columns: Columns, row: int) -> tuple[Int[Array, " k"], tuple[int, int]]:
    """Order of a row's columns in three groups, from plain to rich, and the counts up to the end of the first two.

    The first group has laws whose columns depend only on the recorded motion, such as friction and couplings. The
    second has the tolerance parameters and the other laws without a shape (a nonlinear parameter). The third has all
    others.
    """
    group = dict.fromkeys(range(len(columns.tolerance_parameters)), 1)
    for term in columns.terms:
        effect = term.effect
        if not term.named or effect.inertial is not None:
            continue
        of_motion = not (effect.follows_model or effect.follows_torque or effect.scales_joint)
        if of_motion and (effect.scope == "pair" or not term.shape):
            group |= dict.fromkeys(term.columns, 0)
        elif not term.shape:
            group |= dict.fromkeys(term.columns, 1)
    groups = np.array([group.get(column, 2) for column in columns.rows[row]])
    return np.argsort(groups, kind="stable"), (int((groups == 0).sum()), int((groups <= 1).sum()))


def weights_of(white: Columns, noise: Series) -> Weights:
    """Weights of squared residuals, from rms and autocorrelation time of each joint's noise after whitening.

    Without noise, as in a simulation, a weight would be infinite. So the root mean square is at least a millionth of
    the standard deviation of the modelled torque.
    """
    rows = len(white.rows)
    floor, spread = np.zeros(rows), np.ones(rows)
    for j in range(rows):
        parts = [e[:, j][u[:, j]] for e, u in zip(noise, white.usable, strict=True)]
        torque = max(float(np.std(np.concatenate([t[:, j] for t in white.model_torque]))), 1e-12)
        floor[j] = max(rms(parts), 1e-6 * torque)
        spread[j] = np.mean([autocorrelation_time(e) for e in parts])
    return Weights(floor, spread)


def noise_floor(session: Session, columns: Columns, noise: Series) -> Float[Array, " nv"]:
    """Root mean square of each joint's noise in the judged band [N m or N]; above zero even without any sample."""
    narrow, rows = session.in_judged_band(noise), range(len(columns.rows))
    own = [rms([e[:, j][u[:, j]] for e, u in zip(narrow, columns.usable, strict=True)]) for j in rows]
    return np.maximum(own, least_noise(columns))


def _weighted_rms(
    parts: Sequence[Float[Array, " n"]], use: Sequence[Bool[Array, " n"]], roots: Sequence[Float[Array, " n"]]
) -> float:
    """Root mean square of a row's usable samples, each multiplied by the root of its weight."""
    return rms([(part * root)[u] for part, u, root in zip(parts, use, roots, strict=True)])


def rms(parts: list[Float[Array, " n"]]) -> float:
    """Root mean square of all values of several series; zero if they are empty."""
    joined = np.concatenate(parts)
    return float(np.sqrt(np.mean(joined**2))) if len(joined) else 0.0


def smaller_noise(search: Search, chosen: frozenset[Term], noise: Series) -> tuple[Series, float]:
    """Noise of each joint: the held-out residual of a fit of the chosen effects if it is smaller than the given noise.

    The given noise may be too large: it is the error of flexible fits, which overfit short recordings.

    Returns:
        The noise, and the smallest ratio of new to old root mean square over the rows.
    """
    problem = search.problem
    residual = residual_after(problem, held_out_torque(problem, chosen, search.held_out_fit(chosen)))
    out = [part.copy() for part in noise]
    ratio = 1.0
    for j in range(len(problem.columns.rows)):
        use = [u[:, j] for u in problem.columns.usable]
        own = [part[:, j] for part in noise]
        roots = root_weights(problem.columns, own, j)
        new, old = (_weighted_rms(series, use, roots) for series in ([part[:, j] for part in residual], own))
        if 0 < new < old:
            ratio = min(ratio, new / old)
            for k, r in enumerate(residual):
                out[k][:, j] = np.where(use[k], r[:, j], 0.0)
    return tuple(out), ratio


def noise_without_remainder(
    search: Search, tried: frozenset[Term], chosen: frozenset[Term], noise: Series
) -> tuple[Series, float]:
    """Noise minus the part that belongs to effects in ``tried`` but not in ``chosen``.

    Flexible fits with many columns do not predict an effect in full on held-out blocks, so the remainder of the effect
    counts as noise. Least squares on the whitened noise estimate the remainder as a share of the effect's held-out
    torque.

    Returns:
        The noise, and the decrease of the weighted sum of squares of the whitened noise.
    """
    problem = search.problem
    with_it, without = (held_out_torque(problem, terms, search.held_out_fit(terms)) for terms in (tried, chosen))
    effect = tuple(a - b for a, b in zip(with_it, without, strict=True))
    filters = whitening_of(problem.columns, noise)
    white, white_effect = filters.series(noise), filters.series(effect)
    out, gain = [part.copy() for part in noise], 0.0
    for j, weight in enumerate(problem.weights.per_sample):
        use = [usable[:, j] for usable in problem.white.usable]
        # The whitened noise and the whitened torque of the effect in all logs.
        e, x = (
            np.concatenate([part[u, j] for part, u in zip(series, use, strict=True)])
            for series in (white, white_effect)
        )
        product, square = float(x @ e), float(x @ x)
        if product <= 0:
            continue
        share = min(product / square, 1.0)
        gain += weight * share * (2.0 * product - share * square)
        for part, torque, usable in zip(out, effect, problem.columns.usable, strict=True):
            part[:, j] -= share * np.where(usable[:, j], torque[:, j], 0.0)
    return tuple(out), gain
