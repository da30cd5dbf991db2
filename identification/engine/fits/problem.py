"""Interface of a fitting problem: products of columns, priors and bounds."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from identification.engine.products.grams import Grams
from phantom_dyn.array_types import Float, Int

Array = np.ndarray


class LinearProblem(Protocol):
    """Products of all columns, with priors and bounds of their coefficients; each client of the engine has its own."""

    @property
    def grams(self) -> Grams:
        """Products of the columns, by fold and by block."""
        ...

    @property
    def total_a(self) -> Float[Array, "K K"]:
        """Columns times columns, summed over the training blocks."""
        ...

    @property
    def total_b(self) -> Float[Array, " K"]:
        """Columns times residual, summed over the training blocks."""
        ...

    @property
    def precision(self) -> Float[Array, " K"]:
        """Prior precision of each coefficient about zero."""
        ...

    @property
    def lower(self) -> Float[Array, " K"]:
        """Least value of each coefficient."""
        ...

    @property
    def upper(self) -> Float[Array, " K"]:
        """Largest value of each coefficient."""
        ...

    @property
    def nuisance_count(self) -> int:
        """Number of nuisances (parameters with a prior that are no candidate effect). Their columns come first."""
        ...

    @property
    def fitted_nuisances(self) -> Int[Array, " m"]:
        """Indices of the nuisances that every fit contains, in order."""
        ...


class Solution(Protocol):
    """Coefficients of a fit."""

    @property
    def theta(self) -> Float[Array, " K"]:
        """All coefficients, zero where a column is not in the fit."""
        ...

    @property
    def active(self) -> Int[Array, " k"]:
        """Columns in the fit."""
        ...
