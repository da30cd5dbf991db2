"""How far the parameters of a fit change if an effect follows another law with the same parameters.

For example, the bristle of presliding friction may slip at once or gradually. Data that do not separate the two laws
give a different displacement with each.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from identification.diagnosis.fit.whole_model import (
    Linearised,
    ModelLayout,
    TermSlices,
    central_difference,
    in_band,
    term_torque,
    weighted_products,
)
from identification.engine.numerics.bounded import bounded_solve
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.rival import OtherLaw

# Number of Gauss-Newton steps from one law to the other.
_STEPS = 4


def other_law_shift(
    layout: ModelLayout,
    model: Linearised,
    x: Float[Array, " p"],
    slices: TermSlices,
    law: OtherLaw,
    limits: tuple[Float[Array, " p"], Float[Array, " p"], Float[Array, " p"]],
) -> Float[Array, " p"]:
    """Shift of all parameters if one term follows another law, from Gauss-Newton steps with that law's Jacobian.

    Each shape parameter stays within a factor of two of its value under the term's own law, because it has the same
    meaning in both laws. All other terms keep their first-order expansion.

    Args:
        layout: The terms of the model.
        model: The fitted model, expanded to first order about ``x``.
        x: The fitted parameters.
        slices: The term whose law is replaced.
        law: The other law.
        limits: Prior precision, lower bound and upper bound of each parameter, ``(p,)`` each.
    """
    precision, lower, upper = limits[0], limits[1].copy(), limits[2].copy()
    lower[slices.shape], upper[slices.shape] = np.sort([0.5 * x[slices.shape], 2.0 * x[slices.shape]], axis=0)
    at = slices.indices
    own_law = term_torque(layout, slices, x)
    candidate = x
    for _ in range(_STEPS):
        of_others = candidate - x
        of_others[at] = 0.0
        own, shape = candidate[slices.coefficients], candidate[slices.shape]
        torque, slopes = [], []
        for log, expanded in enumerate(model.slopes):
            by_other_law = partial(_by_other_law, layout, slices.term.joint, law, log)
            torque.append(model.torque[log] + expanded @ of_others + by_other_law(own, shape) - own_law[log])
            replaced = expanded.copy()
            for k, column in enumerate(at):
                replaced[:, :, column] = central_difference(by_other_law, own, shape, k)
            slopes.append(replaced)
        a, b, _ = weighted_products(layout, Linearised(tuple(torque), tuple(slopes)))
        total, gradient = a.sum(axis=0) + np.diag(precision), b.sum(axis=0) - precision * candidate
        candidate = candidate + bounded_solve(total, gradient, lower - candidate, upper - candidate)
    return candidate - x


def _by_other_law(
    layout: ModelLayout, joint: str | None, law: OtherLaw, log: int, own: Float[Array, " k"], shape: Float[Array, " m"]
) -> Float[Array, "n nv"]:
    """Torque of a term that follows another law with the same parameters, in the judged band."""
    return in_band(layout, log, law(layout.operations[log], joint, own, shape))
