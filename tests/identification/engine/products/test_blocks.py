"""Folds of blocks. Oracle: counts by hand."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products.blocks import FOLDS, assign_folds


@pytest.fixture(scope="module")
def two(lab, planar2):
    """Two recordings of different length; no fit sees the second."""
    recordings = (
        lab.recording(planar2, lab.motion(2, 1, seconds=16.0)),
        lab.recording(planar2, lab.motion(2, 2, seconds=7.0), seed=1),
    )
    return lab.prepared(planar2, recordings, held_out=1)


def test_blocks_of_a_log_that_is_held_out_have_no_fold(two):
    assert [fold < 0 for fold in two.folds] == [block.log == 1 for block in two.blocks]


def test_folds_take_turns_so_that_each_covers_the_recording(two):
    folds = assign_folds(two.blocks, np.zeros(2, dtype=bool))
    np.testing.assert_array_equal(folds, np.arange(len(two.blocks)) % FOLDS)
