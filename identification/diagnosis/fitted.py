"""What a fit gives, and what of it the next one may start from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.bounded import solve
from identification.diagnosis.problem import Problem
from identification.diagnosis.terms import Term
from phantom_dyn.effects.payload import Payload

Array = np.ndarray


@dataclass(frozen=True)
class Fitted:
    """Result of one fit.

    Attributes:
        theta: All coefficients, zero where a column is not in the model, ``(K,)``.
        active: Columns in the model.
        normal: Products of what was fitted, priors counted, ``(n, n)``.
        expand: Active coefficients that a unit of each number that was fitted moves, None if they are the same.
        penalty: What the moves of the nuisances cost: their squares in sigmas, summed.
        objective: Loss over all training blocks with penalty and priors, in sample, up to a constant.
        loss: Weighted squared residual of each block's core, each predicted by a fit that has not seen it, ``(B,)``.
        fold_theta: Coefficients of the fit that has not seen each fold, ``(F, K)``.
    """

    theta: Float[Array, " K"]
    active: Int[Array, " k"]
    normal: Float[Array, "n n"]
    expand: Float[Array, "k n"] | None
    penalty: float
    objective: float
    loss: Float[Array, " B"]
    fold_theta: Float[Array, "F K"]

    @property
    def total(self) -> float:
        """Held-out loss over all blocks, and what the moves of the nuisances cost."""
        return float(self.loss.sum()) + self.penalty

    @cached_property
    def cov(self) -> Float[Array, "k k"]:
        """Covariance of the active coefficients, priors counted: of few fits anybody asks for it."""
        inverse = solve(self.normal, np.eye(len(self.normal)))
        return inverse if self.expand is None else self.expand @ inverse @ self.expand.T


@dataclass(frozen=True)
class Near:
    """A similar fit, to start from.

    Attributes:
        theta: All coefficients, NaN where a column is not in it, ``(K,)``.
        payload: Mass and first moments of a payload, ``(4,)``; None if there was none.
    """

    theta: Float[Array, " K"]
    payload: Float[Array, " 4"] | None = None

    @staticmethod
    def nothing(problem: Problem) -> Near:
        """No similar fit is known."""
        return Near(np.full(len(problem.precision), np.nan))

    def after(self, found: Fitted, terms: tuple[Term, ...]) -> Near:
        """A fit of these terms, and the payload of the last fit that had one."""
        theta, payload = np.full(len(found.theta), np.nan), self.payload
        theta[found.active] = found.theta[found.active]
        for term in terms:
            if isinstance(term.effect, Payload):
                payload = found.theta[list(term.columns[:4])]
        return Near(theta, payload)
