"""Whether a residual asks for more columns. Oracle: series whose causes are known."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.friction.position_dependent_friction import foresees


@pytest.mark.parametrize(("size", "asked"), [(0.0, False), (0.15, False), (0.6, True), (2.0, True)])
def test_columns_are_asked_for_where_they_foresee_a_tenth_of_what_is_left(rng, size, asked):
    # Known truth: a cause with size^2 / (1 + size^2) of the squares, beside one that plain columns explain.
    plain, columns, noise = rng.normal(size=(4000, 2)), rng.normal(size=(4000, 3)), rng.normal(size=4000)
    torque = plain @ [3.0, -5.0] + size * columns[:, 0] + noise
    assert foresees(torque, plain, columns) is asked


def test_what_happens_in_one_block_alone_is_not_foreseen(rng):
    # Known truth: a cause that acts in the first eighth of the time.
    columns = rng.normal(size=(4000, 1))
    torque = rng.normal(size=4000) + 5.0 * columns[:, 0] * (np.arange(4000) < 500)
    assert not foresees(torque, np.ones((4000, 1)), columns)
