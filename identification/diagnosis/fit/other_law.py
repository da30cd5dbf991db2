"""How far the parameters of a fit change if an effect follows another law with the same parameters.

For example, the bristle of presliding friction may slip at once or gradually. Data that do not separate the two laws
give a different displacement with each.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.fit.whole_model import (
    Linearised,
    ModelLayout,
    TermSlices,
    other_law_torque,
    term_torque,
    weighted_products,
)
from identification.engine.numerics.bounded import bounded_solve
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.rival import OtherLaw

# Number of Gauss-Newton steps from one law to the other.
_STEPS = 4
# Step of a difference quotient, as a share of the parameter, or of the largest coefficient for a coefficient.
_STEP = 0.03


def other_law_shift(
    layout: ModelLayout,
    model: Linearised,
    x: Float[Array, " p"],
    slices: TermSlices,
    law: OtherLaw,
    limits: tuple[Float[Array, " p"], Float[Array, " p"], Float[Array, " p"]],
) -> Float[Array, " p"]:
    """Shift of all parameters if one term follows another law, by Gauss-Newton steps with the Jacobian of that law.

    Each shape parameter stays within a factor of two of its value under the term's own law, because it has the same
    meaning in both laws. All other terms keep their first-order expansion.

    Args:
        layout: The terms of the model.
        model: The fitted model, expanded to first order about ``x``.
        x: The fitted parameters.
        slices: The term whose law is replaced.
        law: The other law.
        limits: Precision of the priors, lower and upper bounds of all parameters.
    """
    precision, lower, upper = limits[0], limits[1].copy(), limits[2].copy()
    lower[slices.shape], upper[slices.shape] = np.sort([0.5 * x[slices.shape], 2.0 * x[slices.shape]], axis=0)
    at = slices.indices
    own = term_torque(layout, slices, x)
    candidate = x
    for _ in range(_STEPS):
        other = other_law_torque(layout, slices, candidate, law)
        derivatives = [_derivative(layout, slices, candidate, law, k) for k in at]
        torque, slopes = [], []
        for log, expanded in enumerate(model.slopes):
            change = candidate - x
            change[at] = 0.0
            torque.append(model.torque[log] + expanded @ change + other[log] - own[log])
            replaced = expanded.copy()
            replaced[:, :, at] = np.stack([derivative[log] for derivative in derivatives], axis=-1)
            slopes.append(replaced)
        a, b, _ = weighted_products(layout, Linearised(tuple(torque), tuple(slopes)))
        total, gradient = a.sum(axis=0) + np.diag(precision), b.sum(axis=0) - precision * candidate
        candidate = candidate + bounded_solve(total, gradient, lower - candidate, upper - candidate)
    return candidate - x


def _derivative(
    layout: ModelLayout, slices: TermSlices, x: Float[Array, " p"], law: OtherLaw, k: int
) -> tuple[Float[Array, "_ nv"], ...]:
    """Derivative of the torque by another law with respect to parameter ``k``, by central differences, for each log."""
    scaled_by = x[slices.coefficients] if k < slices.coefficients.stop else x[k : k + 1]
    step = np.zeros(len(x))
    step[k] = _STEP * max(float(np.abs(scaled_by).max()), 1e-9)
    above, below = (other_law_torque(layout, slices, x + sign * step, law) for sign in (1.0, -1.0))
    return tuple((high - low) / (2.0 * step[k]) for high, low in zip(above, below, strict=True))
