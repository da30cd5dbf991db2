"""Arrays that nobody can write to. Oracle: NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.motion import read_only, side_by_side


def test_an_array_that_may_be_written_to_is_copied(rng):
    given = rng.normal(size=(5, 2))
    kept = read_only(given)
    before = given.copy()
    given[:] = 0.0
    np.testing.assert_array_equal(kept, before)
    with pytest.raises(ValueError, match="read-only"):
        kept[0, 0] = 1.0


def test_a_copy_that_nobody_can_write_to_is_not_copied_again(rng):
    kept = read_only(rng.normal(size=(5, 2)))
    assert read_only(kept) is kept


def test_a_view_of_what_may_be_written_to_is_copied(rng):
    given = rng.normal(size=5)
    view = given[:]
    view.flags.writeable = False
    assert not np.shares_memory(read_only(view), given)


@pytest.mark.parametrize("count", [1, 4095, 4096, 10000])
def test_columns_side_by_side_are_those_of_numpy(rng, count):
    columns = list(rng.normal(size=(3, count)))
    found = side_by_side(columns)
    np.testing.assert_array_equal(found, np.column_stack(columns))
    assert read_only(found) is found
