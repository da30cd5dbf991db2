"""What claims on each joint are measured by: the gap that its torque leaves, and what the method is accurate to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import row_counts
from identification.diagnosis.fit.problem import Problem
from identification.gates import fair_part
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class RowGaps:
    """What claims are measured by on each row: squares over the noise, summed over the samples.

    Attributes:
        gap: What the given model leaves beyond the noise, moved within its tolerances, ``(nv,)``.
        accuracy: What the method itself may leave, ``(nv,)``.
    """

    gap: Float[Array, " nv"]
    accuracy: Float[Array, " nv"]


def row_gaps(problem: Problem, within: Fitted) -> RowGaps:
    """What claims are measured by in the fits of one problem: squares count by its own weights, in its own band.

    Args:
        problem: Whose fits claim.
        within: Its fit of the moves within the tolerances alone.
    """
    given = np.array([row.core_c.sum() for row in problem.grams.rows])
    given, gap = (np.maximum(loss - row_counts(problem), 0.0) for loss in (given, within.row_losses))
    return RowGaps(gap, fair_part.ACCURACY * given)
